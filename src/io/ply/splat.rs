//! Gaussian splats: PLY files whose vertices are Gaussians, as the 3D Gaussian Splatting programs
//! write them.

use crate::io::differences::Differences;

/// Properties that only Gaussians have, all of them.
const MARKS: [&str; 4] = ["f_dc_0", "opacity", "scale_0", "rot_0"];

/// Returns whether these are the properties of Gaussians.
pub(in crate::io) fn is_splat<'a>(mut names: impl Iterator<Item = &'a str> + Clone) -> bool {
    MARKS.iter().all(|mark| names.by_ref().clone().any(|name| name == *mark))
}

/// Returns whether a property of Gaussians is a spherical harmonic.
pub(in crate::io) fn is_harmonic(name: &str) -> bool {
    name.starts_with("f_rest_") || name.starts_with("f_dc_")
}

/// Leaves out what describes the shape and the look of Gaussians: a cloud has their centres, and
/// `opacity`. Their normals are zero in all such files.
pub(super) fn leave_out_shape(names: &mut [Option<&str>], differences: &mut Differences) {
    if !is_splat(names.iter().copied().flatten()) {
        return;
    }
    let mut harmonics = 0;
    for name in names.iter_mut() {
        let Some(own) = *name else { continue };
        let is_shape = own.starts_with("scale_") || own.starts_with("rot_");
        harmonics += usize::from(is_harmonic(own));
        if is_harmonic(own) || is_shape || ["nx", "ny", "nz"].contains(&own) {
            *name = None;
        }
    }
    differences.leave_out(format!(
        "of the Gaussian splats {harmonics} spherical harmonics, the scales and the rotations \
         (cfreg apply moves them whole)"
    ));
}
