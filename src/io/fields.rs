//! What a cloud is written with: coordinates, then what its points have beside.

use std::io::{self, Write};

use crate::cloud::PointCloud;

/// Whether the coordinates of `cloud` are f32, and lose nothing when written so.
pub(super) fn is_single(cloud: &PointCloud) -> bool {
    cloud.origin() == [0.0; 3]
}

/// Names of all columns beside positions and normals that a cloud is written with: `weight`,
/// then the channels.
pub(super) fn extra_names(cloud: &PointCloud) -> Vec<&str> {
    cloud.weights().map(|_| "weight").into_iter().chain(cloud.channels().names()).collect()
}

/// Their values at point `i`, in that order.
pub(super) fn extra_values(cloud: &PointCloud, i: usize) -> impl Iterator<Item = f32> + '_ {
    let weight = cloud.weights().map(|weights| weights[i]);
    weight.into_iter().chain(cloud.channels().iter().map(move |(_, values)| values[i]))
}

/// Writes the rows in binary, little endian: x, y, z as f32 or f64 as
/// [`is_single`] says, then, as f32, the normal if the cloud has normals, and the others.
pub(super) fn write_binary(out: &mut dyn Write, cloud: &PointCloud) -> io::Result<()> {
    let single = is_single(cloud);
    for (i, (point, position)) in cloud.points().iter().zip(cloud.positions()).enumerate() {
        if single {
            write_floats(out, point)?;
        } else {
            position.iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))?;
        }
        if let Some(normals) = cloud.normals() {
            write_floats(out, &normals[i])?;
        }
        extra_values(cloud, i).try_for_each(|x| out.write_all(&x.to_le_bytes()))?;
    }
    Ok(())
}

fn write_floats(out: &mut dyn Write, values: &[f32; 3]) -> io::Result<()> {
    values.iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))
}
