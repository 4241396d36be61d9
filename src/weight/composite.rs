//! Sums and products of kernels.

use serde::{Deserialize, Serialize};

use super::kernel::WeightKernel;
use super::{Bandwidth, KernelVisitor, WeightScheme};
use crate::error::{Error, Result};

/// Kernels of the catalogue, each with its own bandwidth, added and multiplied.
///
/// A sum combines several scales (`0.7·gaussian(50) + 0.3·cauchy(400)` has a sharp peak and long
/// tails), a product limits one kernel by another. In JSON
/// `{"sum": [{"kernel": "gaussian", "beta": 50}, {"times": [0.3, ...]}]}`.
///
/// ```
/// use cfreg::weight::{Composite, WeightKernel, WeightScheme};
/// let at = |scheme, beta: f64| Composite::kernel(scheme, beta.into());
/// let both = Composite::Product(vec![
///     at(WeightScheme::Gaussian, 100.0),
///     Composite::Times(0.5, Box::new(at(WeightScheme::TruncatedQuadratic, 30.0))),
/// ]);
/// let both = both.resolve(Ok)?;
/// assert_eq!((both.weight(0.0), both.weight(31.0)), (0.5, 0.0));
/// # Ok::<(), cfreg::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Composite {
    /// The sum of all; 0 if empty.
    Sum(Vec<Composite>),
    /// The product of all; 1 if empty.
    Product(Vec<Composite>),
    /// A factor, finite and not negative, times a kernel.
    Times(f32, Box<Composite>),
    /// A kernel of the catalogue at its bandwidth.
    #[serde(untagged)]
    Kernel {
        /// The kernel.
        kernel: WeightScheme,
        /// Its squared bandwidth.
        beta: Bandwidth,
    },
}

/// A composite with numeric bandwidths: a kernel.
#[derive(Debug, Clone, PartialEq)]
pub struct ResolvedComposite {
    /// Operations in postfix order.
    steps: Vec<StackOperation>,
}

/// An operation on a stack of weights.
#[derive(Debug, Clone, Copy, PartialEq)]
enum StackOperation {
    Push(WeightScheme, f64),
    /// The same weight for every distance.
    Constant(f32),
    Times(f32),
    Add,
    Multiply,
}

/// Maximum number of weights on the stack for a distance: sums within products within sums.
const DEPTH: usize = 16;
/// Number of distances evaluated at once.
const CHUNK: usize = 64;

impl Composite {
    /// Creates a kernel of the catalogue.
    pub fn kernel(kernel: WeightScheme, beta: Bandwidth) -> Self {
        Composite::Kernel { kernel, beta }
    }

    /// Resolves the squared bandwidths by `beta` and returns the kernel.
    ///
    /// # Errors
    /// The errors of `beta` and of [`WeightScheme::weight`]; [`Error::Config`] for a factor that is
    /// negative or not finite, and for nesting deeper than 16.
    pub fn resolve<B: Into<Bandwidth>>(
        &self,
        mut beta: impl FnMut(Bandwidth) -> Result<B>,
    ) -> Result<ResolvedComposite> {
        let mut steps = Vec::new();
        self.compile(&mut beta, &mut steps, 1)?;
        Ok(ResolvedComposite { steps })
    }

    fn compile<B: Into<Bandwidth>>(
        &self,
        beta: &mut impl FnMut(Bandwidth) -> Result<B>,
        steps: &mut Vec<StackOperation>,
        depth: usize,
    ) -> Result<()> {
        if depth > DEPTH {
            let rule = format!("kernels may be nested {DEPTH} deep");
            return Err(Error::config("weights", "deeper", rule));
        }
        let (parts, neutral, join) = match self {
            Composite::Kernel { kernel, beta: bandwidth } => {
                let Bandwidth::Fixed(beta) = beta(*bandwidth)?.into() else {
                    let rule = "needs descriptors to find it: give a number";
                    return Err(Error::config("beta", bandwidth, rule));
                };
                kernel.weight(beta, 0.0)?;
                steps.push(StackOperation::Push(*kernel, beta));
                return Ok(());
            }
            Composite::Times(factor, kernel) => {
                if !(*factor >= 0.0 && factor.is_finite()) {
                    let rule = "a factor of weights must be finite and not negative";
                    return Err(Error::config("weights", factor, rule));
                }
                kernel.compile(beta, steps, depth)?;
                steps.push(StackOperation::Times(*factor));
                return Ok(());
            }
            Composite::Sum(parts) => (parts, 0.0, StackOperation::Add),
            Composite::Product(parts) => (parts, 1.0, StackOperation::Multiply),
        };
        for (at, part) in parts.iter().enumerate() {
            // Previous results are below on the stack.
            part.compile(beta, steps, depth + at.min(1))?;
            steps.extend((at > 0).then_some(join));
        }
        steps.extend(parts.is_empty().then_some(StackOperation::Constant(neutral)));
        Ok(())
    }
}

impl WeightKernel for ResolvedComposite {
    fn weight(&self, d2: f32) -> f32 {
        let mut weights = [d2];
        self.fill(&mut weights);
        weights[0]
    }

    #[inline(always)]
    fn fill(&self, d2: &mut [f32]) {
        for chunk in d2.chunks_mut(CHUNK) {
            let (mut stack, mut top) = ([[0.0f32; CHUNK]; DEPTH], 0);
            let n = chunk.len();
            for &step in &self.steps {
                match step {
                    StackOperation::Push(scheme, beta) => {
                        stack[top][..n].copy_from_slice(chunk);
                        let weighed = scheme.visit(beta, Fill(&mut stack[top][..n]));
                        weighed.expect("was weighed by once when it was resolved");
                        top += 1;
                    }
                    StackOperation::Constant(weight) => {
                        stack[top] = [weight; CHUNK];
                        top += 1;
                    }
                    StackOperation::Times(factor) => {
                        stack[top - 1].iter_mut().for_each(|w| *w *= factor)
                    }
                    StackOperation::Add | StackOperation::Multiply => {
                        top -= 1;
                        let (below, above) = stack.split_at_mut(top);
                        let pairs = below[top - 1].iter_mut().zip(&above[0]);
                        match step {
                            StackOperation::Add => pairs.for_each(|(a, b)| *a += b),
                            _ => pairs.for_each(|(a, b)| *a *= b),
                        }
                    }
                }
            }
            chunk.copy_from_slice(&stack[0][..n]);
        }
    }
}

struct Fill<'a>(&'a mut [f32]);

impl KernelVisitor for Fill<'_> {
    type Output = ();
    #[inline(always)]
    fn visit<K: WeightKernel>(self, kernel: K) {
        kernel.fill(self.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn read(json: &str) -> Composite {
        serde_json::from_str(json).unwrap()
    }

    fn fixed(composite: &Composite) -> Result<ResolvedComposite> {
        composite.resolve(Ok)
    }

    proptest! {
        #[test]
        fn it_is_the_arithmetic_of_its_parts(d2 in proptest::collection::vec(0.0..500.0f32, 1..200)) {
            let composite = read(
                r#"{"sum": [
                    {"times": [0.7, {"kernel": "gaussian", "beta": 50}]},
                    {"product": [
                        {"kernel": "cauchy", "beta": 200},
                        {"sum": [{"kernel": "tukey", "beta": 300}, {"kernel": "student-t:3", "beta": 20}]}
                    ]},
                    {"product": []}
                ]}"#,
            );
            let mut weights = d2.clone();
            let kernel = fixed(&composite).unwrap();
            kernel.fill(&mut weights);
            let at = |name: &str, beta: f64, d2: f32| {
                name.parse::<WeightScheme>().unwrap().weight(beta, d2).unwrap()
            };
            for (&d2, &w) in d2.iter().zip(&weights) {
                let inner = at("tukey", 300.0, d2) + at("student-t:3", 20.0, d2);
                let want = 0.7 * at("gaussian", 50.0, d2) + at("cauchy", 200.0, d2) * inner + 1.0;
                prop_assert!((w - want).abs() < 1e-5, "{w} {want}");
                prop_assert_eq!(w, kernel.weight(d2));
            }
        }
    }

    #[test]
    fn json_round_trips() {
        let composite = Composite::Sum(vec![
            Composite::kernel(WeightScheme::StudentT(3.0), Bandwidth::Auto(0.5)),
            Composite::Times(2.0, Box::new(Composite::Product(vec![]))),
        ]);
        let text = serde_json::to_string(&composite).unwrap();
        assert_eq!(
            text,
            r#"{"sum":[{"kernel":"student-t:3","beta":"auto:0.5"},{"times":[2.0,{"product":[]}]}]}"#
        );
        assert_eq!(read(&text), composite);
    }

    #[test]
    fn what_cannot_be_weighed_with_is_refused() {
        let mut deep = Composite::kernel(WeightScheme::Gaussian, 1.0.into());
        for _ in 0..DEPTH - 1 {
            deep = Composite::Sum(vec![Composite::Product(vec![]), deep]);
        }
        assert!(fixed(&deep).is_ok());
        deep = Composite::Sum(vec![Composite::Product(vec![]), deep]);
        let one = || Composite::kernel(WeightScheme::Gaussian, 1.0.into());
        for bad in [
            deep,
            Composite::Times(-1.0, Box::new(one())),
            Composite::Times(f32::NAN, Box::new(one())),
            Composite::kernel(WeightScheme::Gaussian, 0.0.into()),
            Composite::kernel(WeightScheme::StudentT(0.0), 1.0.into()),
            Composite::kernel(WeightScheme::Gaussian, Bandwidth::Auto(0.25)),
        ] {
            assert!(matches!(fixed(&bad), Err(Error::Config { .. })), "{bad:?}");
        }
    }
}
