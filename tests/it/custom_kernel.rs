//! Weights from outside the crate: a kernel of one's own in the full connection, and weights that
//! are made of its moments.

use cfreg::cloud::shape::boulder;
use cfreg::method::{Cf, Register};
use cfreg::moments::Moments;
use cfreg::weight::{Gaussian, Normalization, WeightKernel, WeightScheme};
use cfreg::{PointCloud, Transform};

/// w = β / (β + d²): the weight of Cauchy, written anew.
struct InverseQuadratic {
    beta: f32,
}

impl WeightKernel for InverseQuadratic {
    #[inline(always)]
    fn weight(&self, d2: f32) -> f32 {
        self.beta / (self.beta + d2)
    }
}

fn pair() -> (PointCloud, PointCloud) {
    let truth = Transform::from_rotation_vector([0.3, 1.2, -0.5]);
    let target = boulder().sample(800, 2).unwrap().transformed(&truth).unwrap();
    (boulder().sample(800, 1).unwrap(), target)
}

#[test]
fn a_kernel_of_ones_own_registers_as_the_same_kernel_of_the_crate() {
    let (source, target) = pair();
    let found = Cf::default()
        .register_with(&source, &target, |connection| {
            connection.moments(&InverseQuadratic { beta: 60.0 }, Normalization::Both)
        })
        .unwrap();
    let named = Cf {
        weights: WeightScheme::Cauchy,
        beta: Some(60.0.into()),
        normalization: Normalization::Both,
        ..Cf::default()
    };
    let expected = named.register(&source, &target).unwrap();
    let off = found.transform.after(&expected.transform.inverse());
    assert!(off.angle() < 1e-4, "{}", off.angle());
    assert!((found.moments.weight / expected.moments.weight - 1.0).abs() < 1e-4);
    assert_eq!(found.method.settings["weights"], "custom");
}

#[test]
fn moments_of_two_kernels_add_up() {
    let (source, target) = pair();
    let (mut sum, mut parts) = (None, None);
    let cf = Cf::default();
    cf.register_with(&source, &target, |connection| {
        let narrow = connection.moments(&Gaussian { beta: 50.0 }, Normalization::None)?;
        let wide = connection.moments(&InverseQuadratic { beta: 20.0 }, Normalization::None)?;
        let mut both: Moments = narrow;
        both.merge(&wide);
        (sum, parts) = (Some(both), Some([narrow, wide]));
        Ok(both)
    })
    .unwrap();
    let [narrow, wide] = parts.unwrap();
    let sum = sum.unwrap();
    assert!((sum.weight - narrow.weight - wide.weight).abs() < 1e-9 * sum.weight);
    let residual = |moments: &Moments| moments.residual(&Transform::IDENTITY);
    let apart = residual(&narrow) + residual(&wide);
    assert!((residual(&sum) / apart - 1.0).abs() < 1e-9);
}
