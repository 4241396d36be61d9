//! How long does it take to read a cloud of 100,000 points with normals in each format?
//!
//! The files lie in the system's cache: this is parsing, not the disk. Read elements
//! (points) per second.

use cfreg::cloud::shape::boulder;
use cfreg::math::Vec3;
use cfreg::{PointCloud, io};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};

const POINTS: usize = 100_000;

fn bench(criterion: &mut Criterion) {
    let bare = boulder().sample(POINTS, 1).unwrap();
    let points: Vec<Vec3> = bare.positions().collect();
    let cloud = PointCloud::with_normals(&points, &points).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let mut group = criterion.benchmark_group("reading");
    group.sample_size(10).throughput(Throughput::Elements(POINTS as u64));
    for name in ["cloud.ply", "cloud.pcd", "cloud.csv"] {
        let path = folder.path().join(name);
        io::write(&path, &cloud).unwrap();
        assert_eq!(io::read(&path).unwrap().points(), cloud.points());
        group.bench_function(name, |bencher| bencher.iter(|| io::read(&path).unwrap()));
    }
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
