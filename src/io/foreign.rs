//! Files that are not read, by name: formats of programs and devices, and the free program that
//! converts them.

use std::path::Path;

use super::content_error::ContentError;
use super::format::extension;

/// Starts of files, the name of their format, and what converts them.
const BY_CONTENT: [(&[u8], &str, &str); 18] = [
    (b"#ROSBAG V", "a ROS bag", BAG),
    (b"\x89MCAP", "an MCAP file of ROS 2", BAG),
    (b"SQLite format 3", "an SQLite database, as bags of ROS 2 are", BAG),
    (b"\x89HDF\r\n\x1a\n", "HDF5", "h5py: numpy.save(\"points.npy\", file[NAME][:])"),
    (b"# vtk DataFile", "VTK", VTK),
    (b"<?xml", "XML", "ParaView or CloudCompare, if it holds points"),
    (b"glTF", "glTF", "Blender or trimesh, which write PLY"),
    (b"Kaydara FBX", "FBX", "Blender, which writes PLY"),
    (b"DRACO", "Draco", "draco_decoder of https://github.com/google/draco"),
    (b"PAR1", "Parquet", "pandas: read_parquet(...).to_csv(...)"),
    (b"\xd4\xc3\xb2\xa1", PCAP, VELODYNE),
    (b"\xa1\xb2\xc3\xd4", PCAP, VELODYNE),
    (b"\x0a\x0d\x0d\x0a", PCAP, VELODYNE),
    (b"\x89PNG", "a PNG image", IMAGE),
    (b"\xff\xd8\xff", "a JPEG image", IMAGE),
    (b"II*\0", "a TIFF image", IMAGE),
    (b"7z\xbc\xaf", "a 7z archive", UNPACK),
    (b"Rar!", "a RAR archive", UNPACK),
];

/// Extensions, the name of their format, and what converts them.
const BY_EXTENSION: [(&[&str], &str, &str); 14] = [
    (&["bag", "mcap", "db3"], "a bag of ROS", BAG),
    (&["fls", "fws", "lsproj"], "FARO's own format", "FARO SCENE, which exports E57 (trial)"),
    (&["rxp", "rdb", "rdbx", "rsp"], "RIEGL's own format", "RiSCAN PRO, which exports E57 or LAZ"),
    (&["rcp", "rcs"], "Autodesk ReCap", "ReCap, which exports E57 or PTS (trial)"),
    (&["zfs", "zfprj"], "Zoller+Fröhlich's own format", "Z+F LaserControl, which exports E57"),
    (&["lgs", "lgsx", "imp", "ptg"], "Leica's own format", "Cyclone, which exports E57 or PTX"),
    (
        &["tzf", "tdx", "rwp", "rwcx"],
        "Trimble's own format",
        "Trimble RealWorks Viewer, which exports E57",
    ),
    (&["clr", "cl3"], "Topcon's own format", "ScanMaster, which exports E57 or PTX"),
    (&["pod"], "Bentley Pointools", "Pointools, which exports E57 or LAS"),
    (
        &["spz", "splat", "ksplat"],
        "compressed Gaussian splats",
        "SuperSplat (https://superspl.at/editor), which writes PLY",
    ),
    (&["vtk", "vtp", "vtu"], "VTK", VTK),
    (&["h5", "hdf5", "mat"], "HDF5", "h5py: numpy.save(\"points.npy\", file[NAME][:])"),
    (
        &["dxf", "dwg", "dae", "3ds", "fbx", "gltf", "glb", "3mf", "blend"],
        "a format of CAD",
        "CloudCompare or Blender, which write PLY",
    ),
    (
        &["step", "stp", "iges", "igs", "brep"],
        "a format of CAD",
        "FreeCAD, which writes STL or OBJ",
    ),
];

const BAG: &str = "`rosbags` (pip install rosbags) to read PointCloud2 messages, or pcl_ros \
                   `bag_to_pcd`, which writes PCD";
const VTK: &str = "ParaView, which writes PLY and CSV";
const PCAP: &str = "a capture of network packets";
const VELODYNE: &str = "VeloView or LidarView, which write CSV and PCD";
const IMAGE: &str = "Open3D: create_from_depth_image with the camera's matrix, written as PLY";
const UNPACK: &str = "an unpacker first; of archives, gzip is unpacked here";

/// The formats that are read, as messages list them.
pub(super) const READ: &str = "PLY, PCD, LAS, LAZ, E57, PTX, PTS, OBJ, STL, OFF, NPY, NPZ, KITTI \
                               .bin, text (XYZ, TXT, CSV, ASC), and gzip of these";

/// Returns the refusal of a file whose content begins as that of a known format that is not read.
pub(super) fn refusal_by_content(content: &[u8]) -> Option<ContentError> {
    let (_, name, advice) = BY_CONTENT.iter().find(|(start, ..)| content.starts_with(start))?;
    Some(refusal(name, advice))
}

/// Returns the refusal of a file that has the extension of a known format that is not read.
pub(super) fn refusal_by_extension(path: &Path) -> Option<ContentError> {
    let own = extension(path);
    let (_, name, advice) =
        BY_EXTENSION.iter().find(|(names, ..)| names.contains(&own.as_str()))?;
    Some(refusal(name, advice))
}

fn refusal(name: &str, advice: &str) -> ContentError {
    ContentError::new(format!("is {name}, which is not read; convert it with {advice}"))
}

/// Returns the refusal of a file in no known format.
pub(super) fn unknown() -> ContentError {
    ContentError::new(format!("is in no format that is read; these are {READ}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_of_others_are_named() {
        let said =
            |refusal: Option<ContentError>| refusal.unwrap().into_error("a".as_ref()).to_string();
        assert!(said(refusal_by_content(b"#ROSBAG V2.0\n")).contains("rosbags"));
        assert!(said(refusal_by_extension("a.FLS".as_ref())).contains("FARO SCENE"));
        assert!(said(refusal_by_content(b"\x89HDF\r\n\x1a\n")).contains("HDF5"));
        assert!(refusal_by_content(b"1 2 3\n").is_none());
        assert!(refusal_by_extension("a.xyz".as_ref()).is_none());
    }
}
