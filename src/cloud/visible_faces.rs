//! The part of a [`Mesh`] that a range sensor sees.

use super::Mesh;
use crate::error::{Error, Result};
use crate::math::{self, Vec3};

/// Cosine of the most oblique incidence that is still seen, 80°: beyond, triangulating sensors get
/// too little light back, and a sample's footprint is six times as long as wide.
const MIN_INCIDENCE_COSINE: f64 = 0.173_648_177_666_930_33;
/// Tangent of the largest angle from the line of sight, 75°: a plane image cannot show wider views.
const MAX_VIEW_TANGENT: f64 = 3.732_050_807_568_877;
/// Pixels a side of the smallest and of the largest image. Chosen by hand.
const IMAGE_SIZE_RANGE: (f64, f64) = (256.0, 4096.0);

impl Mesh {
    /// Returns which faces a range sensor at `viewpoint` sees, one entry a face. A face is visible
    /// if its front (vertices anticlockwise) is turned to the sensor, at most 80° off, and nothing
    /// of the mesh hides it. A face is seen or not as a whole, by its centre.
    ///
    /// Uses a depth buffer (Catmull 1974) of about four pixels a face, looking towards the
    /// centroid. A face is hidden by a surface in front of it that is nearer by more than the depth
    /// range of a surface of its slope within a pixel.
    ///
    /// # Errors
    /// [`Error::Config`] for a viewpoint that is not finite, or so near that part of the mesh is
    /// more than 75° off the line to the centroid; [`Error::Shape`] when a face refers to a missing
    /// vertex; [`Error::NonFinite`] for a non-finite vertex; [`Error::TooFewPoints`] when the faces
    /// have no area.
    pub fn visible_faces(&self, viewpoint: Vec3) -> Result<Vec<bool>> {
        self.validate()?;
        let (picture, corners) = PerspectiveView::facing_centroid(self, viewpoint)?;
        let nearest = picture.depth_buffer(&self.faces, &corners);
        let seen = |face: &[u32; 3]| {
            let corners = face.map(|v| self.vertices[v as usize]);
            let middle = math::scaled(corners.into_iter().fold([0.0; 3], math::add), 1.0 / 3.0);
            let [a, b, c] = corners;
            let (normal, to) =
                (math::cross(math::sub(b, a), math::sub(c, a)), math::sub(viewpoint, middle));
            let lengths = (math::dot(normal, normal) * math::dot(to, to)).sqrt();
            let cosine = math::dot(normal, to) / lengths;
            if cosine.is_nan() || cosine < MIN_INCIDENCE_COSINE {
                return false;
            }
            let [x, y, depth] = picture.project(middle);
            let slope = (1.0 - (cosine * cosine).min(1.0)).sqrt() / cosine;
            let tolerance = depth / picture.per_unit * (1.0 + slope);
            let first = 1.0 / nearest[picture.at(x as usize, y as usize)];
            depth <= first + tolerance
        };
        Ok(self.faces.iter().map(seen).collect())
    }

    /// Returns the area of the marked faces, in square units.
    ///
    /// # Errors
    /// [`Error::Shape`] unless there is one mark a face, and for a face that refers to a missing
    /// vertex.
    pub fn area_of(&self, faces: &[bool]) -> Result<f64> {
        self.check_marks(faces)?;
        self.check_faces()?;
        let marked = self.faces.iter().zip(faces).filter(|&(_, &marked)| marked);
        Ok(marked.map(|(face, _)| self.face_area(face)).sum())
    }

    /// Returns the marked faces, with the same vertices.
    ///
    /// # Errors
    /// [`Error::Shape`] unless there is one mark a face.
    pub fn select_faces(&self, faces: &[bool]) -> Result<Mesh> {
        self.check_marks(faces)?;
        let marked = self.faces.iter().zip(faces).filter(|&(_, &marked)| marked);
        let faces = marked.map(|(face, _)| *face).collect();
        Ok(Mesh { vertices: self.vertices.clone(), faces })
    }

    fn check_marks(&self, faces: &[bool]) -> Result<()> {
        let (expected, found) = (self.faces.len(), faces.len());
        match expected == found {
            true => Ok(()),
            false => Err(Error::Shape { what: "marks of a mesh's faces".into(), expected, found }),
        }
    }
}

/// A perspective view of a mesh.
struct PerspectiveView {
    viewpoint: Vec3,
    /// Directions right, up and ahead.
    axes: [Vec3; 3],
    /// Corner of the first pixel, in the plane at depth 1.
    low: [f64; 2],
    /// Pixels per unit of that plane.
    per_unit: f64,
    width: usize,
    height: usize,
}

impl PerspectiveView {
    /// Creates the view that contains all of `mesh`, and projects the vertices into it.
    fn facing_centroid(mesh: &Mesh, viewpoint: Vec3) -> Result<(Self, Vec<Vec3>)> {
        let refused = |rule: &str| {
            let value = format!("{viewpoint:?}");
            Err(Error::config("viewpoint", value, rule))
        };
        if viewpoint.iter().any(|x| !x.is_finite()) {
            return refused("every coordinate must be finite");
        }
        let ahead = math::normalized(math::sub(mesh.centroid(), viewpoint));
        // Perpendicular to the coordinate axis that has the largest angle to it.
        let least = (0..3).min_by(|&a, &b| ahead[a].abs().total_cmp(&ahead[b].abs()));
        let mut axis = [0.0; 3];
        axis[least.unwrap_or(0)] = 1.0;
        let right = math::normalized(math::cross(axis, ahead));
        let mut picture = PerspectiveView {
            viewpoint,
            axes: [right, math::cross(ahead, right), ahead],
            low: [0.0; 2],
            per_unit: 1.0,
            width: 1,
            height: 1,
        };
        let mut corners: Vec<Vec3> = mesh.vertices.iter().map(|&v| picture.project(v)).collect();
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for &vertex in mesh.faces.as_flattened() {
            let [x, y, depth] = corners[vertex as usize];
            // Rejects NaN, too: from the centroid itself there is no line of sight.
            if !(depth > 0.0 && x * x + y * y <= MAX_VIEW_TANGENT * MAX_VIEW_TANGENT) {
                return refused("must have all of the mesh within 75° of the line to its centroid");
            }
            for (axis, at) in [x, y].into_iter().enumerate() {
                (low[axis], high[axis]) = (low[axis].min(at), high[axis].max(at));
            }
        }
        let sides = [high[0] - low[0], high[1] - low[1]];
        let side =
            (2.0 * (mesh.faces.len() as f64).sqrt()).clamp(IMAGE_SIZE_RANGE.0, IMAGE_SIZE_RANGE.1);
        picture.low = low;
        picture.per_unit = side / sides[0].max(sides[1]).max(f64::MIN_POSITIVE);
        for [x, y, _] in &mut corners {
            (*x, *y) = ((*x - low[0]) * picture.per_unit, (*y - low[1]) * picture.per_unit);
        }
        let pixels = |length: f64| (length * picture.per_unit) as usize + 1;
        (picture.width, picture.height) = (pixels(sides[0]), pixels(sides[1]));
        Ok((picture, corners))
    }

    /// Returns the position in the image, in pixels from its corner, and the depth.
    #[inline]
    fn project(&self, point: Vec3) -> Vec3 {
        let from = math::sub(point, self.viewpoint);
        let [x, y, depth] = self.axes.map(|axis| math::dot(axis, from));
        let inverse = 1.0 / depth;
        let place = |at: f64, low: f64| (at * inverse - low) * self.per_unit;
        [place(x, self.low[0]), place(y, self.low[1]), depth]
    }

    /// Returns the index of the pixel in that column and row, or of the nearest.
    #[inline]
    fn at(&self, column: usize, row: usize) -> usize {
        row.min(self.height - 1) * self.width + column.min(self.width - 1)
    }

    /// Returns the inverse depth of the nearest surface at the centre of every pixel; 0 for none.
    /// `corners` are the projected vertices.
    fn depth_buffer(&self, faces: &[[u32; 3]], corners: &[Vec3]) -> Vec<f64> {
        let mut nearest = vec![0.0; self.width * self.height];
        for face in faces {
            self.fill(face.map(|v| corners[v as usize]), &mut nearest);
        }
        nearest
    }

    /// Rasterises a triangle row by row. The inverse depth is linear in the image.
    fn fill(&self, [a, b, c]: [Vec3; 3], nearest: &mut [f64]) {
        let twice = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
        if twice == 0.0 || !twice.is_finite() {
            return;
        }
        let [p, q, r] = [a, b, c].map(|corner| 1.0 / corner[2]);
        let across = ((q - p) * (c[1] - a[1]) - (r - p) * (b[1] - a[1])) / twice;
        let down = ((r - p) * (b[0] - a[0]) - (q - p) * (c[0] - a[0])) / twice;
        let edges = [(a, b), (b, c), (c, a)].map(|(from, to)| {
            let (low, high) = if from[1] <= to[1] { (from, to) } else { (to, from) };
            (low, high[1], (high[0] - low[0]) / (high[1] - low[1]))
        });
        // Rows and columns whose centres, at whole numbers and a half, are inside.
        let whole = |at: f64, all: usize| ((at + 0.5) as usize).min(all);
        let (low, high) = (a[1].min(b[1]).min(c[1]), a[1].max(b[1]).max(c[1]));
        for row in whole(low, self.height)..whole(high, self.height) {
            let y = row as f64 + 0.5;
            let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
            for (low, end, slope) in edges {
                if low[1] <= y && y < end {
                    let x = low[0] + (y - low[1]) * slope;
                    (left, right) = (left.min(x), right.max(x));
                }
            }
            let at_left = p + down * (y - a[1]) - across * a[0];
            for column in whole(left, self.width)..whole(right, self.width) {
                let inverse = at_left + across * (column as f64 + 0.5);
                let place = &mut nearest[row * self.width + column];
                *place = place.max(inverse);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Creates a ball of `radius` about zero.
    fn ball(radius: f64) -> Mesh {
        let (rings, sectors) = (100u32, 200u32);
        let mut vertices = Vec::new();
        for ring in 0..=rings {
            let polar = std::f64::consts::PI * f64::from(ring) / f64::from(rings);
            for sector in 0..sectors {
                let azimuth = std::f64::consts::TAU * f64::from(sector) / f64::from(sectors);
                let (s, z) = polar.sin_cos();
                vertices.push(math::scaled([s * azimuth.cos(), s * azimuth.sin(), z], radius));
            }
        }
        let mut faces = Vec::new();
        for (ring, sector) in (0..rings).flat_map(|r| (0..sectors).map(move |s| (r, s))) {
            let (upper, lower) = (ring * sectors, (ring + 1) * sectors);
            let next = (sector + 1) % sectors;
            faces.push([upper + sector, lower + sector, lower + next]);
            faces.push([upper + sector, lower + next, upper + next]);
        }
        Mesh { vertices, faces }
    }

    /// Creates a square in the plane `z`, of `cells` a side, whose front faces +z.
    fn square(half: f64, z: f64, cells: u32) -> Mesh {
        let at = |i: u32| half * (2.0 * f64::from(i) / f64::from(cells) - 1.0);
        let grid = |n: u32| (0..n).flat_map(move |y| (0..n).map(move |x| (x, y)));
        let vertices = grid(cells + 1).map(|(x, y)| [at(x), at(y), z]).collect();
        let corner = |x, y| y * (cells + 1) + x;
        let two = |(x, y)| {
            let [a, b, c, d] =
                [corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1)];
            [[a, b, c], [a, c, d]]
        };
        Mesh { vertices, faces: grid(cells).flat_map(two).collect() }
    }

    fn joined(one: Mesh, other: Mesh) -> Mesh {
        let shift = one.vertices.len() as u32;
        let moved = other.faces.iter().map(|face| face.map(|v| v + shift));
        let faces = one.faces.iter().copied().chain(moved).collect();
        Mesh { vertices: [one.vertices, other.vertices].concat(), faces }
    }

    fn seen_share(mesh: &Mesh, viewpoint: Vec3) -> f64 {
        let seen = mesh.visible_faces(viewpoint).unwrap();
        mesh.area_of(&seen).unwrap() / mesh.area_of(&vec![true; seen.len()]).unwrap()
    }

    #[test]
    fn of_a_ball_the_cap_is_seen_that_geometry_says() {
        // Incidence i is at the polar angle i − asin(sin i / distance); visibility ends at 80°.
        let limit = MIN_INCIDENCE_COSINE.acos();
        for (distance, places) in
            [(1.3, [0.3, -0.5, 0.81]), (4.0, [1.0, 0.0, 0.0]), (500.0, [0.0, 0.2, -1.0])]
        {
            let end = limit - (limit.sin() / distance).asin();
            let want = (1.0 - end.cos()) / 2.0;
            let viewpoint = math::scaled(math::normalized(places), 2.0 * distance);
            let found = seen_share(&ball(2.0), viewpoint);
            // A row of faces about the cap's rim.
            assert!((found - want).abs() < 0.01, "{distance}: {found} {want}");
        }
    }

    #[test]
    fn of_a_box_the_sides_that_face_the_sensor_are_seen() {
        let [o, i] = [0.0, 1.0];
        let vertices = vec![
            [o, o, o],
            [i, o, o],
            [i, i, o],
            [o, i, o],
            [o, o, i],
            [i, o, i],
            [i, i, i],
            [o, i, i],
        ];
        let sides =
            [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [3, 7, 6, 2], [0, 4, 7, 3], [1, 2, 6, 5]];
        let faces = sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let cube = Mesh { vertices, faces };
        let seen = |viewpoint| {
            let seen = cube.visible_faces(viewpoint).unwrap();
            (0..6).filter(|&side| seen[2 * side] && seen[2 * side + 1]).collect::<Vec<_>>()
        };
        assert_eq!(seen([0.5, 0.5, 9.0]), [1]);
        assert_eq!(seen([-3.0, 0.5, 4.0]), [1, 4]);
        assert_eq!(seen([4.0, -4.0, -4.0]), [0, 2, 5]);
        assert_eq!(cube.area_of(&cube.visible_faces([4.0, 4.0, 4.0]).unwrap()).unwrap(), 3.0);
    }

    #[test]
    fn an_occluder_hides_its_shadow() {
        // A square of half side 0.25, half way to the sensor, hides one of half side 0.5.
        for flipped in [false, true] {
            let mut near = square(0.25, 2.0, 40);
            if flipped {
                near.faces.iter_mut().for_each(|face| face.swap(1, 2));
            }
            let plane = square(1.0, 0.0, 100);
            let scene = joined(plane.clone(), near);
            let seen = scene.visible_faces([0.0, 0.0, 4.0]).unwrap();
            let hidden: Vec<bool> = seen[..plane.faces.len()].iter().map(|seen| !seen).collect();
            let area = plane.area_of(&hidden).unwrap();
            // Half a row of cells, 0.01, along the shadow's rim of length 4.
            assert!((area - 1.0).abs() < 0.045, "{area}");
            let front = seen[plane.faces.len()..].iter().filter(|&&seen| seen).count();
            assert_eq!(front, if flipped { 0 } else { 3200 });
        }
    }

    #[test]
    fn a_plane_is_lost_beyond_eighty_degrees() {
        let plane = square(0.01, 0.0, 10);
        let from = |degrees: f64| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            plane.visible_faces([5.0 * sin, 0.0, 5.0 * cos]).unwrap().into_iter().all(|seen| seen)
        };
        assert!(from(79.0) && !from(81.0) && !from(170.0));
    }

    #[test]
    fn a_part_is_a_mesh_with_its_area() {
        let ball = ball(1.0);
        let seen = ball.visible_faces([3.0, 0.0, 0.0]).unwrap();
        let part = ball.select_faces(&seen).unwrap();
        let whole = vec![true; part.faces.len()];
        assert_eq!(part.area_of(&whole).unwrap(), ball.area_of(&seen).unwrap());
        assert_eq!(seen, ball.visible_faces([3.0, 0.0, 0.0]).unwrap());
    }

    #[test]
    fn what_cannot_be_seen_is_refused() {
        let ball = ball(1.0);
        for near in [[0.0; 3], [1.01, 0.0, 0.0], [f64::NAN, 0.0, 0.0]] {
            let refused = ball.visible_faces(near);
            assert!(matches!(refused, Err(Error::Config { field: "viewpoint", .. })), "{near:?}");
        }
        let far = [9.0, 0.0, 0.0];
        let mut lost = ball.clone();
        lost.faces[7][1] = 1_000_000;
        assert!(matches!(lost.visible_faces(far), Err(Error::Shape { .. })));
        let mut broken = ball.clone();
        broken.vertices[9][2] = f64::INFINITY;
        assert!(matches!(broken.visible_faces(far), Err(Error::NonFinite { index: 9, .. })));
        let empty = Mesh { vertices: vec![[0.0; 3]], faces: vec![] };
        assert!(matches!(empty.visible_faces(far), Err(Error::TooFewPoints { .. })));
        assert!(matches!(ball.select_faces(&[true]), Err(Error::Shape { .. })));
        assert!(matches!(ball.area_of(&[true]), Err(Error::Shape { .. })));
    }
}
