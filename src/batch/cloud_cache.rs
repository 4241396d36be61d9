//! The clouds of a list: each is read once and cached within a memory budget, with the data that
//! methods compute from it alone.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock};

use super::hash::Fnv1a;
use crate::cloud::{Parts, PointCloud};
use crate::error::Result;
use crate::filter::Downsampling;
use crate::method::{Cache, Cached};
use crate::par;

/// Clouds that were read; the least recently used is evicted first.
pub(super) struct CloudCache {
    thinning: Downsampling,
    budget: usize,
    state: Mutex<CacheState>,
}

#[derive(Default)]
struct CacheState {
    clouds: HashMap<CacheKey, CacheSlot>,
    bytes: usize,
    /// Increases with every use.
    clock: u64,
}

/// A file, and the random stream for its downsampling.
type CacheKey = (PathBuf, u64);

struct CacheSlot {
    cloud: Arc<OnceLock<ReadResult>>,
    bytes: usize,
    used: u64,
}

/// A cloud, or the message of the error, for all callers that wait for a file that cannot be read.
pub(super) type ReadResult = std::result::Result<Arc<CachedCloud>, String>;

/// A cloud, and the data computed from it.
pub(super) struct CachedCloud {
    key: CacheKey,
    cloud: PointCloud,
    cache: Cache,
}

impl CachedCloud {
    pub(super) fn cached(&self) -> Cached<'_> {
        Cached { cloud: &self.cloud, cache: Some(&self.cache) }
    }
}

impl CloudCache {
    /// Creates an empty cache that holds at most `budget` bytes of clouds that no pair is using.
    pub(super) fn new(thinning: Downsampling, budget: usize) -> Self {
        CloudCache { thinning, budget, state: Mutex::default() }
    }

    /// Returns the cloud in `path`, read by `read` if it is not cached; a second caller waits while
    /// the first reads.
    pub(super) fn get(
        &self,
        path: &Path,
        stream: u64,
        read: impl FnOnce() -> Result<PointCloud>,
    ) -> ReadResult {
        // The sides of a pair differ only in random draws.
        let stream = if self.thinning.sample.is_some() { stream } else { 0 };
        let key = (path.to_path_buf(), stream);
        let cell = {
            let mut held = self.lock();
            held.clock += 1;
            let used = held.clock;
            let empty = || CacheSlot { cloud: Arc::default(), bytes: 0, used };
            let slot = held.clouds.entry(key.clone()).or_insert_with(empty);
            slot.used = used;
            slot.cloud.clone()
        };
        let mut fresh = false;
        let read = cell.get_or_init(|| {
            fresh = true;
            let cloud = read().and_then(|cloud| self.thinning.apply(cloud, stream));
            let keep =
                |cloud| Arc::new(CachedCloud { key: key.clone(), cloud, cache: Cache::default() });
            cloud.map(keep).map_err(|error| error.to_string())
        });
        if fresh {
            self.lock().resize(&key, memory_size(read.as_deref().ok()), self.budget);
        }
        read.clone()
    }

    /// Updates the size of a cloud after more data was computed since [`get`](Self::get).
    pub(super) fn touch(&self, kept: &CachedCloud) {
        self.lock().resize(&kept.key, memory_size(Some(kept)), self.budget);
    }

    fn lock(&self) -> MutexGuard<'_, CacheState> {
        par::lock(&self.state)
    }
}

impl CacheState {
    /// Updates the size of a cloud that was read or extended, and evicts others if needed.
    fn resize(&mut self, key: &CacheKey, bytes: usize, budget: usize) {
        let Some(slot) = self.clouds.get_mut(key) else { return };
        self.bytes = self.bytes - slot.bytes + bytes;
        slot.bytes = bytes;
        while self.bytes > budget {
            let read = self.clouds.iter().filter(|(_, slot)| slot.bytes > 0);
            let Some(key) = read.min_by_key(|(_, slot)| slot.used).map(|(key, _)| key.clone())
            else {
                return;
            };
            self.bytes -= self.clouds.remove(&key).map_or(0, |slot| slot.bytes);
        }
    }
}

/// Returns the bytes of a cloud and of its cache entry.
fn memory_size(kept: Option<&CachedCloud>) -> usize {
    const OVERHEAD: usize = 512;
    OVERHEAD + kept.map_or(0, |kept| kept.cloud.bytes() + kept.cache.bytes())
}

/// Adds all data of a cloud to a hash.
pub(super) fn hash_cloud(hash: &mut Fnv1a, cloud: &PointCloud) {
    let Parts { points, origin, frame_origin, normals, weights, channels, descriptors, .. } =
        cloud.parts();
    let mut many = |name: &str, numbers: &[f32]| {
        hash.add_text(name);
        hash.add_number(numbers.len() as f64);
        numbers.iter().for_each(|&x| hash.add_number(x.into()));
    };
    many("points", points.as_flattened());
    many("normals", normals.unwrap_or_default().as_flattened());
    many("weights", &weights.unwrap_or_default());
    channels.iter().for_each(|(name, values)| many(name, values));
    if let Some(rows) = descriptors {
        many(&format!("descriptors {}", rows.dim()), rows.as_slice());
    }
    let places = [Some(origin), Some(frame_origin), cloud.viewpoint()];
    places.iter().flatten().flatten().for_each(|&x| hash.add_number(x));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io;
    use crate::method::{Method, Register};

    #[test]
    fn the_least_recently_used_goes_first() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, "0 0 0\n1 0 0\n0 1 0\n0 0 1\n").unwrap();
            path
        };
        let [a, b, c] = ["a.xyz", "b.xyz", "c.xyz"].map(file);
        let one = 512 + 4 * 12;
        let clouds = CloudCache::new(Downsampling::default(), 2 * one);
        let first = clouds.get(&a, 0, || io::read(&a)).unwrap();
        clouds.get(&b, 0, || io::read(&b)).unwrap();
        // Cached even if the file is gone.
        std::fs::remove_file(&a).unwrap();
        assert!(Arc::ptr_eq(&first, &clouds.get(&a, 1, || io::read(&a)).unwrap()));
        clouds.get(&c, 0, || io::read(&c)).unwrap();
        assert_eq!(clouds.lock().bytes, 2 * one);
        assert!(clouds.get(&a, 0, || io::read(&a)).is_ok());
        std::fs::remove_file(&b).unwrap();
        let failed = clouds.get(&b, 0, || io::read(&b)).err().unwrap();
        assert!(failed.contains("b.xyz"));
    }

    #[test]
    fn what_is_made_of_clouds_counts() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str| {
            let path = folder.path().join(name);
            let at = |i: usize| {
                let (x, y) = ((i % 20) as f64, (i / 20) as f64);
                [x, y, (0.5 * x).sin() + (0.3 * x + 0.7 * y).cos()]
            };
            let cloud = PointCloud::new(&(0..300).map(at).collect::<Vec<_>>()).unwrap();
            io::write(&path, &cloud).unwrap();
            path
        };
        let [a, b] = ["a.ply", "b.ply"].map(file);
        let clouds = CloudCache::new(Downsampling::default(), 150_000);
        let get = |path: &Path| clouds.get(path, 0, || io::read(path)).unwrap();
        let [first, second] = [&a, &b].map(|path| get(path));
        let plain = clouds.lock().bytes;
        let method: Method = "cf".parse().unwrap();
        method.register_cached(first.cached(), second.cached()).unwrap();
        clouds.touch(&first);
        let one = clouds.lock().bytes;
        assert!(one > plain + 300 * 33 * 4 && one < plain + 300 * 60 * 4, "{plain} {one}");
        // A second touch adds nothing.
        clouds.touch(&first);
        assert_eq!(clouds.lock().bytes, one);
        clouds.touch(&second);
        assert_eq!(clouds.lock().bytes, 2 * one - plain);
        // Beyond the budget the least recently used cloud is evicted, with all data computed from
        // it.
        let third = clouds.get(&b, 0, || io::read(&b)).unwrap();
        assert!(Arc::ptr_eq(&second, &third));
        let few = CloudCache { budget: one, ..clouds };
        few.touch(&second);
        assert_eq!(few.lock().clouds.keys().map(|key| &key.0).collect::<Vec<_>>(), [&b]);
    }

    #[test]
    fn without_room_nothing_is_held() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.xyz");
        std::fs::write(&path, "0 0 0\n1 0 0\n").unwrap();
        let sample = Downsampling { sample: Some(1), ..Downsampling::default() };
        let clouds = CloudCache::new(sample, 0);
        assert_eq!(clouds.get(&path, 0, || io::read(&path)).unwrap().cloud.len(), 1);
        assert!(clouds.lock().clouds.is_empty() && clouds.lock().bytes == 0);
    }
}
