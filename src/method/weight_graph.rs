//! Connections of a method: the weights themselves, to see why a pose was found.

use faer::Mat;
use rustc_hash::FxHashSet;

use super::cf_spectral::SpectralConnections;
use super::registration::Timings;
use super::teaser::correspondences::match_features;
use super::weight_links::{WeightBlock, WeightGraph, WeightedLink};
use super::{Cached, Cf, CfSpectral, Cfk, Method, Teaser};
use crate::cloud::{Descriptors, PointCloud, Transform};
use crate::error::Result;
use crate::keypoint::Keypoints;
use crate::math::{self, Vec3};
use crate::moments::{Entries, FeatureView, FullConnection};
use crate::par;
use crate::search::SearchTree;
use crate::weight::{Bandwidth, Normalization, WeightScheme};

/// Most rows of a block. Chosen by hand.
const MAX_BLOCK_ROWS: usize = 144;

impl Method {
    /// Returns the connections of this method between its input clouds, under the `pose` that it
    /// found: computes again up to the weights. `None` for methods that connect points by position,
    /// and for weights without a name ([`Cf::register_with`]).
    ///
    /// # Errors
    /// Those of [`Register::register`](super::Register::register).
    ///
    /// ```
    /// use cfreg::method::{Method, Register};
    /// # use cfreg::cloud::shape::boulder;
    /// # let (source, target) = (boulder().sample(600, 1)?, boulder().sample(600, 2)?);
    /// let method: Method = "cf".parse()?;
    /// let found = method.register(&source, &target)?;
    /// let connections = method.weight_graph(&source, &target, &found.transform)?.unwrap();
    /// assert_eq!(connections.links.len(), 600);
    /// # Ok::<(), cfreg::Error>(())
    /// ```
    pub fn weight_graph(
        &self,
        source: &PointCloud,
        target: &PointCloud,
        pose: &Transform,
    ) -> Result<Option<WeightGraph>> {
        self.weight_graph_cached(source.into(), target.into(), pose)
    }

    /// [`weight_graph`](Self::weight_graph) with caches.
    pub(super) fn weight_graph_cached(
        &self,
        source: Cached<'_>,
        target: Cached<'_>,
        pose: &Transform,
    ) -> Result<Option<WeightGraph>> {
        match self {
            Method::Cf(Cf { weights: WeightScheme::Custom, .. }) => Ok(None),
            Method::Cfk(Cfk { cf: connection, .. })
                if connection.weights == WeightScheme::Custom =>
            {
                Ok(None)
            }
            Method::Cf(cf) => cf.weight_graph(source, target, pose, None).map(Some),
            Method::Cfk(Cfk { keypoints, cf: connection }) => {
                connection.weight_graph(source, target, pose, Some(keypoints)).map(Some)
            }
            Method::Consensus(consensus) => consensus.weight_graph(source, target, pose).map(Some),
            Method::Teaser(teaser) => teaser.weight_graph(source, target, pose).map(Some),
            Method::CfSpectral(method) => method.weight_graph(source, target, pose).map(Some),
            Method::Icp(_) | Method::Kc(_) | Method::Cpd(_) | Method::Dare(_) => Ok(None),
        }
    }
}

impl Cf {
    fn weight_graph(
        &self,
        source: Cached<'_>,
        target: Cached<'_>,
        pose: &Transform,
        detector: Option<&Keypoints>,
    ) -> Result<WeightGraph> {
        par::with_threads(self.threads, || {
            let times = &mut Timings::default();
            let [source, target] = self.features.extract_pair([source, target], detector, times)?;
            let connection = source.connection(&target)?;
            let beta = connection.bandwidth(self.bandwidth())?;
            let ends = [source.view(), target.view()];
            let mut matrix = WeightBlock::from_nearest_points(ends, pose)?;
            let WeightBlock { rows, columns, .. } = &matrix;
            let found =
                connection.entries(self.weights, beta, self.normalization, rows, columns)?;
            let Entries { source_sums, target_sums, heaviest, block } = found;
            matrix.weights = block;
            let links = heaviest.iter().zip(0..);
            let links = links.map(|(&(weight, target), source)| WeightedLink {
                source,
                target,
                weight: f64::from(weight),
            });
            Ok(WeightGraph {
                full: true,
                inlier_distance: None,
                points: ends.map(global_positions),
                weight_sums: [source_sums, target_sums],
                links: sort_by_weight(links.collect()),
                block: matrix,
            })
        })?
    }
}

impl Teaser {
    fn weight_graph(
        &self,
        source: Cached<'_>,
        target: Cached<'_>,
        pose: &Transform,
    ) -> Result<WeightGraph> {
        par::with_threads(self.threads, || {
            let times = &mut Timings::default();
            let bound = self.resolve_noise_bound(source, target)?;
            let [source, target] = self.features.extract_pair([source, target], None, times)?;
            let ends = [source.view(), target.view()];
            let pairs = match_features(&FullConnection::new(ends[0], ends[1])?, self.cross_check);
            let [p, q] = ends.map(global_positions);
            let agreement = pairs
                .iter()
                .map(|&(i, j)| inlier_weight(pose, p[i as usize], q[j as usize], bound));
            WeightGraph::from_correspondences(ends, &pairs, agreement, bound, pose)
        })?
    }
}

impl Teaser {
    /// Returns the given correspondences, with their inlier weights under `pose`.
    pub(super) fn given_weight_graph(
        &self,
        [source, target]: [&PointCloud; 2],
        pairs: &[(u32, u32)],
        pose: &Transform,
    ) -> Result<WeightGraph> {
        let bound = self.resolve_noise_bound(source.into(), target.into())?;
        let points = [source, target].map(|cloud| cloud.positions().collect::<Vec<Vec3>>());
        let block = WeightBlock::from_pairs([source, target], pairs, pose)?;
        let [p, q] = &points;
        let agreement: Vec<f64> = pairs
            .iter()
            .map(|&(i, j)| inlier_weight(pose, p[i as usize], q[j as usize], bound))
            .collect();
        Ok(WeightGraph::from_links(points, pairs, agreement.into_iter(), bound, block))
    }
}

/// Returns 1 − r²/bound², or 0 if the residual r is above the bound.
fn inlier_weight(pose: &Transform, p: Vec3, q: Vec3, bound: f64) -> f64 {
    let off = math::sub(pose.apply(p), q);
    (1.0 - math::dot(off, off) / (bound * bound)).max(0.0)
}

impl CfSpectral {
    fn weight_graph(
        &self,
        source: Cached<'_>,
        target: Cached<'_>,
        pose: &Transform,
    ) -> Result<WeightGraph> {
        par::with_threads(self.threads, || {
            let connected = self.connect([source, target], &mut Timings::default())?;
            let ends = connected.sides.each_ref().map(|side| side.view());
            let mut block = WeightBlock::from_nearest_points(ends, pose)?;
            block.add_connections(ends, &connected)?;
            let points = ends.map(global_positions);
            let mut sums = points.each_ref().map(|points| vec![0.0; points.len()]);
            let mut links = Vec::new();
            for (pair, weight) in connected.first.iter().zip(connected.weights()) {
                let (source, target) = (pair.source, pair.target);
                sums[0][source as usize] += weight;
                sums[1][target as usize] += weight;
                links.push(WeightedLink { source, target, weight });
            }
            Ok(WeightGraph {
                full: false,
                inlier_distance: Some(self.compatibility.length_tolerance * connected.unit),
                points,
                weight_sums: sums,
                links: sort_by_weight(links),
                block,
            })
        })?
    }
}

impl WeightGraph {
    /// Builds the graph of correspondences with their inlier weights under the pose, where ends
    /// nearer than `reach` are inliers.
    pub(super) fn from_correspondences(
        ends: [FeatureView<'_>; 2],
        pairs: &[(u32, u32)],
        agreement: impl Iterator<Item = f64>,
        reach: f64,
        pose: &Transform,
    ) -> Result<WeightGraph> {
        let connection = FullConnection::new(ends[0], ends[1])?;
        let beta = connection.bandwidth(Bandwidth::Auto(Bandwidth::DEFAULT_SHARE))?;
        let mut matrix = WeightBlock::from_nearest_points(ends, pose)?;
        let WeightBlock { rows, columns, .. } = &matrix;
        let likeness = (WeightScheme::Gaussian, Normalization::Both);
        matrix.weights = connection.entries(likeness.0, beta, likeness.1, rows, columns)?.block;
        Ok(WeightGraph::from_links(ends.map(global_positions), pairs, agreement, reach, matrix))
    }

    /// Builds the graph of these correspondences, with their weights.
    fn from_links(
        points: [Vec<Vec3>; 2],
        pairs: &[(u32, u32)],
        agreement: impl Iterator<Item = f64>,
        reach: f64,
        block: WeightBlock,
    ) -> WeightGraph {
        let mut received = points.each_ref().map(|points| vec![0.0; points.len()]);
        let mut links = Vec::new();
        for (&(source, target), weight) in pairs.iter().zip(agreement) {
            received[0][source as usize] += weight;
            received[1][target as usize] += weight;
            links.push(WeightedLink { source, target, weight });
        }
        WeightGraph {
            full: false,
            inlier_distance: Some(reach),
            points,
            weight_sums: received,
            links: sort_by_weight(links),
            block,
        }
    }
}

impl WeightBlock {
    /// Returns the points of a block without weights.
    fn from_nearest_points(
        [source, target]: [FeatureView<'_>; 2],
        pose: &Transform,
    ) -> Result<WeightBlock> {
        let step = source.points.len().div_ceil(MAX_BLOCK_ROWS).max(1);
        let rows: Vec<u32> = (0..source.points.len() as u32).step_by(step).collect();
        let looks = project_on_principal_axis(source.descriptors, &rows);
        let places = rows
            .iter()
            .map(|&row| math::add(source.points[row as usize].map(f64::from), source.origin));
        let (columns, distances) = nearest_points(places, target.points, target.origin, pose)?;
        let (weights, first_order) = (Vec::new(), Vec::new());
        Ok(WeightBlock { rows, columns, distances, principal_feature: looks, weights, first_order })
    }

    /// Returns the block of given correspondences, 1 for each: without descriptors.
    fn from_pairs(
        [source, target]: [&PointCloud; 2],
        pairs: &[(u32, u32)],
        pose: &Transform,
    ) -> Result<WeightBlock> {
        let mut rows: Vec<u32> = pairs.iter().map(|pair| pair.0).collect();
        rows.sort_unstable();
        rows.dedup();
        let step = rows.len().div_ceil(MAX_BLOCK_ROWS).max(1);
        let rows: Vec<u32> = rows.into_iter().step_by(step).collect();
        let places = rows.iter().map(|&row| source.position(row as usize));
        let (columns, distances) = nearest_points(places, target.points(), target.origin(), pose)?;
        let given: FxHashSet<(u32, u32)> = pairs.iter().copied().collect();
        let joined = |&row: &u32| {
            let given = &given;
            columns.iter().map(move |&column| f32::from(u8::from(given.contains(&(row, column)))))
        };
        let weights = rows.iter().flat_map(joined).collect();
        let principal_feature = vec![0.0; rows.len()];
        let first_order = Vec::new();
        Ok(WeightBlock { rows, columns, distances, principal_feature, weights, first_order })
    }
}

/// Returns the target point nearest to each of `places` under the pose, and its distance.
fn nearest_points(
    places: impl Iterator<Item = Vec3>,
    target: &[[f32; 3]],
    origin: Vec3,
    pose: &Transform,
) -> Result<(Vec<u32>, Vec<f64>)> {
    let tree = SearchTree::new(target)?;
    let nearest = places.map(|place| {
        let moved = math::sub(pose.apply(place), origin).map(|x| x as f32);
        let nearest = tree.nearest(&moved);
        (nearest.index, f64::from(nearest.squared_distance).sqrt())
    });
    Ok(nearest.unzip())
}

impl WeightBlock {
    /// Adds the weights of both orders of each connection to the entry whose row and column are
    /// nearest to its ends.
    fn add_connections(
        &mut self,
        [source, target]: [FeatureView<'_>; 2],
        connected: &SpectralConnections,
    ) -> Result<()> {
        let at = |view: FeatureView<'_>, indices: &[u32]| -> Vec<[f32; 3]> {
            indices.iter().map(|&i| view.points[i as usize]).collect()
        };
        let columns = at(target, &self.columns);
        let trees = [SearchTree::new(&at(source, &self.rows))?, SearchTree::new(&columns)?];
        let n = self.rows.len();
        self.weights = vec![0.0; n * n];
        self.first_order = vec![0.0; n * n];
        for (pair, second) in connected.first.iter().zip(connected.weights()) {
            let row = trees[0].nearest(&source.points[pair.source as usize]).index as usize;
            let nearest = trees[1].nearest(&target.points[pair.target as usize]).index as usize;
            // Rows on the same target point have equal columns: prefer the diagonal.
            let column = if columns[row] == columns[nearest] { row } else { nearest };
            self.weights[row * n + column] += second as f32;
            self.first_order[row * n + column] += pair.weight as f32;
        }
        Ok(())
    }
}

/// Projects the given rows on their first principal axis.
fn project_on_principal_axis(descriptors: &Descriptors, rows: &[u32]) -> Vec<f64> {
    let (n, dim) = (rows.len(), descriptors.dim());
    let row = |k: usize| descriptors.row(rows[k] as usize);
    let mut mean = vec![0.0; dim];
    for k in 0..n {
        mean.iter_mut().zip(row(k)).for_each(|(sum, &x)| *sum += f64::from(x) / n as f64);
    }
    let centred = Mat::from_fn(n, dim, |k, d| f64::from(row(k)[d]) - mean[d]);
    let Ok(parts) = centred.thin_svd() else { return vec![0.0; n] };
    let first = parts.V().col(0);
    // The axis has either sign: choose that in which its largest component is above 0.
    let largest =
        (0..dim).map(|d| first[d]).fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a });
    let sign = if largest < 0.0 { -1.0 } else { 1.0 };
    (0..n).map(|k| sign * (0..dim).map(|d| centred[(k, d)] * first[d]).sum::<f64>()).collect()
}

/// Returns the positions of a side's points in its cloud's own frame.
fn global_positions(side: FeatureView<'_>) -> Vec<Vec3> {
    side.points.iter().map(|p| math::add(p.map(f64::from), side.origin)).collect()
}

/// Sorts the heaviest first; equal weights by source point.
fn sort_by_weight(mut links: Vec<WeightedLink>) -> Vec<WeightedLink> {
    links.sort_by(|a, b| b.weight.total_cmp(&a.weight));
    links
}
