//! Triangles of a PLY file: from its faces, or from a scanner's range grid.

use super::body::{PlyBody, Row, RowPlan};
use super::header::{Element, PropertyKind};
use crate::io::content_error::ContentError;

/// Names of the list of corners.
const CORNERS: [&str; 2] = ["vertex_indices", "vertex_index"];

/// Reads the triangles of all faces: a face of more than three corners is a fan about its first; a
/// face of fewer has none.
pub(super) fn read_faces(
    body: &mut PlyBody<'_>,
    element: &Element,
    vertices: usize,
) -> Result<Vec<[u32; 3]>, ContentError> {
    let mut triangles = Vec::new();
    for_each_face(body, element, vertices, |corners| {
        if let [first, rest @ ..] = corners {
            triangles.extend(rest.windows(2).map(|pair| [*first, pair[0], pair[1]]));
        }
    })?;
    Ok(triangles)
}

/// Reads the triangles of a range grid, row by row; each grid cell is empty or one vertex. Four
/// neighbours with a vertex give two triangles, three give one. MeshLab reads the Stanford scans
/// so.
pub(super) fn read_range_grid(
    body: &mut PlyBody<'_>,
    element: &Element,
    vertices: usize,
    infos: &[String],
) -> Result<Vec<[u32; 3]>, ContentError> {
    let size = |name: &str| {
        let value =
            infos.iter().find_map(|info| info.trim().strip_prefix(name)?.trim().parse().ok());
        value.ok_or_else(|| {
            ContentError::new(format!("has a range grid but no obj_info {name} NUMBER"))
        })
    };
    let (columns, rows): (usize, usize) = (size("num_cols")?, size("num_rows")?);
    if columns.checked_mul(rows) != Some(element.count) {
        let count = element.count;
        let what = format!("has {count} places in a range grid of {columns} columns, {rows} rows");
        return Err(ContentError::new(what));
    }
    let mut places = Vec::new();
    for_each_face(body, element, vertices, |corners| places.push(corners.first().copied()))?;
    let mut triangles = Vec::new();
    for cell in
        (0..places.len()).filter(|at| (at + 1) % columns != 0 && at + columns < places.len())
    {
        // Around the square, so that any three in this order face the same way.
        let around = [cell, cell + 1, cell + columns + 1, cell + columns].map(|at| places[at]);
        let seen: Vec<u32> = around.into_iter().flatten().collect();
        match seen[..] {
            [a, b, c, d] => triangles.extend([[a, b, c], [a, c, d]]),
            [a, b, c] => triangles.push([a, b, c]),
            _ => {}
        }
    }
    Ok(triangles)
}

/// Calls `use_corners` with the vertex indices of each element.
fn for_each_face(
    body: &mut PlyBody<'_>,
    element: &Element,
    vertices: usize,
    mut use_corners: impl FnMut(&[u32]),
) -> Result<(), ContentError> {
    let name = &element.name;
    let is_list = |kind| matches!(kind, PropertyKind::List(..));
    let list = element.properties.iter().position(|property| {
        let is_corners = CORNERS.iter().any(|name| name.eq_ignore_ascii_case(&property.name));
        is_corners && is_list(property.kind)
    });
    let Some(list) = list else {
        let what = format!("element {name} has no list vertex_indices");
        return Err(ContentError::new(what));
    };
    let (plan, mut row) = (RowPlan::new(element, |_| false, Some(list)), Row::default());
    let most = vertices.min(u32::MAX as usize) as f64;
    for index in 0..body.check_count(element)? {
        body.next(&plan, index, &mut row)?;
        let corner = |&value: &f64| {
            let known = value >= 0.0 && value < most && value.fract() == 0.0;
            let what = || format!("{name} {index} names vertex {value} of {vertices}");
            known.then_some(value as u32).ok_or_else(|| ContentError::new(what()))
        };
        use_corners(&row.list.iter().map(corner).collect::<Result<Vec<u32>, ContentError>>()?);
    }
    Ok(())
}
