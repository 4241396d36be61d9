// The numbers of the page, as they are packed in it.

function bytesOf(text) {
  const raw = atob(text);
  const bytes = new Uint8Array(raw.length);
  for (let k = 0; k < raw.length; k++) bytes[k] = raw.charCodeAt(k);
  return bytes;
}

// Little-endian, as all machines with a browser are.
const shortsOf = (text) => new Uint16Array(bytesOf(text).buffer);
const signedOf = (text) => new Int8Array(bytesOf(text).buffer);
const floatsOf = (text) => new Float32Array(bytesOf(text).buffer);

// A 4x4 matrix of rows as three.js has it.
function matrixOf(rows) {
  return new THREE.Matrix4().set(...rows.flat());
}

function colourOf(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

// Viridis at five places (van der Walt and Smith 2015): told apart by most eyes, and in grey.
const RAMP = ["#440154", "#3b528b", "#21918c", "#5ec962", "#fde725"];

function rampAt(share) {
  const at = Math.min(Math.max(share, 0), 1) * (RAMP.length - 1);
  const k = Math.min(Math.floor(at), RAMP.length - 2);
  const part = (colour, shift) => (parseInt(colour.slice(1), 16) >> shift) & 255;
  const mix = (shift) => part(RAMP[k], shift) + (at - k) * (part(RAMP[k + 1], shift) - part(RAMP[k], shift));
  return [mix(16), mix(8), mix(0)];
}
