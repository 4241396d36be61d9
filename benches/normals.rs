//! How long do neighbours and normals take, k = 150, as the cloud grows?
//!
//! `neighbors` is the k-nearest search alone, `normals` the estimation on neighbourhoods
//! that are already known. Both grow about linearly; read elements (points) per second.

mod common;

use cfreg::cloud::shape::boulder;
use cfreg::normals::{self, Orientation};
use cfreg::search::{Neighborhood, Neighbors};
use common::SIZES;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};

const K: Neighborhood = Neighborhood::Nearest(150);

fn bench(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("normals");
    group.sample_size(10);
    for n in SIZES {
        let cloud = boulder().sample(n, 1).unwrap();
        let neighbors = Neighbors::find(cloud.points(), K).unwrap();
        let estimate = || normals::estimate(&cloud, &neighbors, Orientation::Outward).unwrap();
        // The surface is smooth and the samples dense: every point has a unit normal.
        let found = estimate();
        assert!(
            found.undefined_count() == 0
                && found
                    .vectors
                    .iter()
                    .all(|n| { (n.iter().map(|x| x * x).sum::<f32>() - 1.0).abs() < 1e-5 })
        );
        group.throughput(Throughput::Elements(n as u64));
        group.bench_function(BenchmarkId::new("neighbors", n), |bencher| {
            bencher.iter(|| Neighbors::find(cloud.points(), K).unwrap());
        });
        group.bench_function(BenchmarkId::new("normals", n), |bencher| bencher.iter(estimate));
    }
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
