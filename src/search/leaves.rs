//! A cloud in an order in which neighbours are near each other in memory, cut into leaves.

use std::ops::Range;

/// Points a leaf; the last leaf has the rest. Chosen by hand.
pub(super) const LEAF: usize = 32;

/// Points in kd-order; every [`LEAF`] of them are a leaf of the tree over them.
pub(super) struct Leaves {
    /// Index of each point in the cloud.
    pub(super) order: Vec<u32>,
    /// Coordinates in that order, one array an axis.
    pub(super) axes: [Vec<f32>; 3],
    /// Nodes in preorder: a node's first child follows it.
    nodes: Vec<Node>,
}

struct Node {
    extent: BoundingBox,
    /// The leaves below this node.
    leaves: Range<u32>,
    /// Index of its second child; 0 for a leaf.
    second: u32,
}

/// A box.
#[derive(Clone, Copy)]
pub(super) struct BoundingBox {
    low: [f32; 3],
    high: [f32; 3],
}

impl BoundingBox {
    /// Returns the bounding box of any points.
    pub(super) fn from_points(points: impl Iterator<Item = [f32; 3]>) -> Self {
        let mut extent = BoundingBox { low: [f32::INFINITY; 3], high: [f32::NEG_INFINITY; 3] };
        for point in points {
            for a in 0..3 {
                extent.low[a] = extent.low[a].min(point[a]);
                extent.high[a] = extent.high[a].max(point[a]);
            }
        }
        extent
    }

    /// Returns a lower bound of the squared distance of two points of the boxes, also in the
    /// arithmetic of [`squared_distance`]: every step is the same, and none decreases by rounding.
    fn squared_gap(&self, other: &BoundingBox) -> f32 {
        let gap = |a: usize| {
            let (below, above) = (other.low[a] - self.high[a], self.low[a] - other.high[a]);
            below.max(above).max(0.0)
        };
        let [x, y, z] = [gap(0), gap(1), gap(2)];
        x * x + y * y + z * z
    }

    /// Returns an upper bound of the squared distance of two points of the box.
    pub(super) fn squared_diagonal(&self) -> f32 {
        squared_distance(self.low, self.high)
    }
}

/// Returns the squared distance of two points; the same bits for any vector width.
#[inline(always)]
pub(crate) fn squared_distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    let [x, y, z] = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    x * x + y * y + z * z
}

impl Leaves {
    /// Builds the leaves of `points`, which must be finite.
    pub(super) fn new(points: &[[f32; 3]]) -> Self {
        let mut places: Vec<([f32; 3], u32)> =
            points.iter().enumerate().map(|(i, &point)| (point, i as u32)).collect();
        let mut nodes = Vec::with_capacity(2 * points.len().div_ceil(LEAF));
        build_nodes(&mut places, 0, &mut nodes);
        Leaves {
            order: places.iter().map(|place| place.1).collect(),
            axes: [0, 1, 2].map(|a| places.iter().map(|place| place.0[a]).collect()),
            nodes,
        }
    }

    /// Returns the number of points.
    pub(super) fn len(&self) -> usize {
        self.order.len()
    }

    /// Returns the points of a leaf, by their positions in the order.
    pub(super) fn places(&self, leaf: usize) -> Range<usize> {
        leaf * LEAF..((leaf + 1) * LEAF).min(self.len())
    }

    /// Returns the point at a position of the order.
    pub(super) fn point(&self, place: usize) -> [f32; 3] {
        [0, 1, 2].map(|a| self.axes[a][place])
    }

    /// Returns the box of a leaf, and the box of the smallest node around it with `count` points,
    /// or of all points.
    pub(super) fn enclosing_boxes(&self, leaf: usize, count: usize) -> (BoundingBox, BoundingBox) {
        let (mut at, mut around) = (0, 0);
        while self.nodes[at].second != 0 {
            let second = self.nodes[at].second as usize;
            at = if leaf < self.nodes[second].leaves.start as usize { at + 1 } else { second };
            let Range { start, end } = self.nodes[at].leaves;
            let points = (end as usize * LEAF).min(self.len()) - start as usize * LEAF;
            if points >= count {
                around = at;
            }
        }
        (self.nodes[at].extent, self.nodes[around].extent)
    }

    /// Lists, in order, the leaves that may have points within a squared distance of a box.
    ///
    /// If leaves contain a single position, the same as the box, only as many are listed as have
    /// `enough` points: the first ones, whose indices are the lowest.
    pub(super) fn leaves_within(
        &self,
        extent: &BoundingBox,
        squared_distance: f32,
        enough: usize,
        listed: &mut Vec<u32>,
        stack: &mut Vec<u32>,
    ) {
        listed.clear();
        stack.clear();
        stack.push(0);
        let mut heaped = 0;
        while let Some(at) = stack.pop() {
            let node = &self.nodes[at as usize];
            // Not `>`: no gap is NaN, but a limit may be infinite.
            if node.extent.squared_gap(extent) > squared_distance {
                continue;
            }
            if node.second != 0 {
                stack.extend([node.second, at + 1]);
                continue;
            }
            let is_place = |extent: &BoundingBox| extent.low == extent.high;
            if is_place(extent) && is_place(&node.extent) && extent.low == node.extent.low {
                heaped += LEAF;
                if heaped >= enough + 2 * LEAF {
                    continue;
                }
            }
            listed.push(node.leaves.start);
        }
    }
}

/// Halves `places`, starting at the leaf `first`, across their longest side until leaves remain;
/// equal coordinates are ordered by index.
fn build_nodes(places: &mut [([f32; 3], u32)], first: u32, nodes: &mut Vec<Node>) {
    let extent = BoundingBox::from_points(places.iter().map(|place| place.0));
    let count = places.len().div_ceil(LEAF);
    let at = nodes.len();
    nodes.push(Node { extent, leaves: first..first + count as u32, second: 0 });
    if count <= 1 {
        return;
    }
    let side = |a: usize| extent.high[a] - extent.low[a];
    let axis = (1..3).fold(0, |a, b| if side(b) > side(a) { b } else { a });
    let half = count / 2 * LEAF;
    places
        .select_nth_unstable_by(half, |(p, i), (q, j)| p[axis].total_cmp(&q[axis]).then(i.cmp(j)));
    let (near, far) = places.split_at_mut(half);
    build_nodes(near, first, nodes);
    nodes[at].second = nodes.len() as u32;
    build_nodes(far, first + (count / 2) as u32, nodes);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leaves_hold_every_point_once_and_near_ones_are_listed() {
        let points: Vec<[f32; 3]> =
            (0..1000u32).map(|i| [i % 10, i / 10 % 10, i / 100].map(|x| x as f32)).collect();
        let leaves = Leaves::new(&points);
        let mut seen = leaves.order.clone();
        seen.sort_unstable();
        assert!(seen.iter().enumerate().all(|(at, &i)| at == i as usize));
        let (mut listed, mut stack) = (Vec::new(), Vec::new());
        for leaf in 0..1000usize.div_ceil(LEAF) {
            let (extent, around) = leaves.enclosing_boxes(leaf, 100);
            assert!(around.squared_diagonal() >= extent.squared_diagonal());
            leaves.leaves_within(&extent, 4.0, 1000, &mut listed, &mut stack);
            assert!(listed.is_sorted());
            for place in leaves.places(leaf) {
                let of = leaves.point(place);
                let near = (0..1000).filter(|&j| squared_distance(of, leaves.point(j)) <= 4.0);
                for other in near {
                    assert!(listed.contains(&((other / LEAF) as u32)));
                }
            }
        }
    }
}
