//! How long does FPFH take, k = 150, on neighbourhoods and normals that are known?
//!
//! Grows linearly with the cloud; read elements (points) per second.

mod common;

use cfreg::cloud::shape::boulder;
use cfreg::descriptor::{BINS, HistogramScale, fpfh};
use cfreg::normals::{self, Orientation};
use cfreg::search::{Neighborhood, Neighbors};
use common::SIZES;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};

fn bench(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("fpfh");
    group.sample_size(10);
    for n in SIZES {
        let cloud = boulder().sample(n, 1).unwrap();
        let points = cloud.points();
        let neighbors = Neighbors::find(points, Neighborhood::Nearest(150)).unwrap();
        let normals = normals::estimate(&cloud, &neighbors, Orientation::Outward).unwrap();
        let describe = || fpfh(points, &normals.vectors, &neighbors, HistogramScale::Pcl).unwrap();
        for row in describe().rows() {
            assert!(row.len() == BINS && (row.iter().sum::<f32>() - 300.0).abs() < 1e-2);
        }
        group.throughput(Throughput::Elements(n as u64));
        group.bench_function(BenchmarkId::new("pcl", n), |bencher| bencher.iter(describe));
    }
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
