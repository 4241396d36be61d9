//! What does one solve cost in each closed form, once the moments are there?
//!
//! Microseconds that do not grow with the clouds: next to weighing they are nothing, so
//! the choice of a solver is never one of speed.

use cfreg::Transform;
use cfreg::moments::Moments;
use cfreg::pose::{self, ScaleEstimate, Solver};
use criterion::{Criterion, criterion_group, criterion_main};

fn bench(criterion: &mut Criterion) {
    let truth = Transform::from_rotation_vector([0.4, -1.0, 0.7]);
    let mut moments = Moments::about([0.0; 3], [0.0; 3]);
    for p in [[1.0, 0.2, 0.0], [0.0, 1.0, 0.3], [-1.0, -2.0, 0.7], [0.5, 0.5, -2.0]] {
        moments.add_pair(0.5, p, truth.apply(p));
    }
    let mut group = criterion.benchmark_group("closed_forms");
    for solver in Solver::ALL {
        let solve = || pose::solve(&moments, solver, ScaleEstimate::Fixed).unwrap();
        assert!(solve().transform.after(&truth.inverse()).angle() < 1e-9);
        group.bench_function(solver.to_string(), |bencher| bencher.iter(solve));
    }
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
