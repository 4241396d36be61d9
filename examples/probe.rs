use cfreg::{*, method::*, experiment::accuracy::*};
fn main() {
    let d = std::env::var("CFREG_DATA").unwrap();
    for f in ["stanford_bunny/bun000.ply","stanford_meshes/bun_zipper.ply"] {
        let model = io::read(format!("{d}/{f}")).unwrap();
        for m in [Motion::Small, Motion::Large] {
            let r = run(&model, &"cf".parse().unwrap(), Protocol{motion:m,..Default::default()}, |_|{}).unwrap();
            println!("{f} {m} {:?} deg {:?} fail {}", r.statistics(|e| e.rotation_frobenius), r.statistics(|e| e.rotation_deg), r.failures());
        }
    }
}
