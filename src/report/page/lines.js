// Connections as lines, and the motions that nothing holds as arrows.

const TOGETHER = "#009e73";
const APART = "#cc79a7";

function makeLines(weights) {
  const [from, onto, agree] = [floatsOf(weights.from), floatsOf(weights.onto), bytesOf(weights.agree)];
  const places = new Float32Array(2 * from.length);
  const colours = new Float32Array(2 * from.length);
  for (let k = 0; k < agree.length; k++) {
    const colour = plainColour(agree[k] ? TOGETHER : APART).toArray();
    colours.set([...colour, ...colour], 6 * k);
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(places, 3));
  geometry.setAttribute("color", new THREE.BufferAttribute(colours, 3));
  const lines = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ vertexColors: true }));
  lines.frustumCulled = false;
  const end = new THREE.Vector3();
  return {
    lines,
    // Where the source stands now.
    place(matrix) {
      for (let k = 0; k < agree.length; k++) {
        end.fromArray(from, 3 * k).applyMatrix4(matrix).toArray(places, 6 * k);
        places.set(onto.subarray(3 * k, 3 * k + 3), 6 * k + 3);
      }
      geometry.attributes.position.needsUpdate = true;
    },
  };
}

// Over all else, so that points do not hide them.
function arrowMaterial() {
  const material = new THREE.MeshBasicMaterial({ depthTest: false, transparent: true, opacity: 0.9 });
  material.color.setRGB(...plainColour("#d55e00").toArray());
  return material;
}

function makeArrow(arrow, radius) {
  const group = new THREE.Group();
  const material = arrowMaterial();
  const thick = 0.012 * radius;
  const add = (geometry, change) => {
    const part = new THREE.Mesh(geometry, material);
    change(part);
    part.renderOrder = 2;
    group.add(part);
  };
  const head = () => new THREE.ConeGeometry(3.2 * thick, 9 * thick, 20);
  if (arrow.slides) {
    const half = 0.75 * radius;
    add(new THREE.CylinderGeometry(thick, thick, 2 * half, 12), () => {});
    add(head(), (part) => part.position.set(0, half, 0));
    add(head(), (part) => { part.position.set(0, -half, 0); part.rotation.z = Math.PI; });
  }
  if (arrow.turns) {
    const ring = 0.55 * radius;
    const arc = 1.6 * Math.PI;
    // The ring lies in the plane of x and z, about y.
    add(new THREE.TorusGeometry(ring, thick, 10, 64, arc), (part) => { part.rotation.x = Math.PI / 2; });
    for (const [at, way] of [[0, 1], [arc, -1]]) {
      add(head(), (part) => {
        part.position.set(ring * Math.cos(at), 0, ring * Math.sin(at));
        const along = new THREE.Vector3(Math.sin(at), 0, -Math.cos(at)).multiplyScalar(way);
        part.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), along);
      });
    }
    if (!arrow.slides) {
      add(new THREE.CylinderGeometry(0.4 * thick, 0.4 * thick, 1.5 * radius, 8), () => {});
    }
  }
  group.position.set(...arrow.center);
  group.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), new THREE.Vector3(...arrow.axis).normalize());
  return group;
}
