//! Values computed from one cloud alone, cached for its further pairs.

use std::any::Any;
use std::sync::{Arc, Mutex, TryLockError};

use crate::cloud::PointCloud;
use crate::error::Result;
use crate::par::{self, lock};
use crate::search;

/// Cache of values that methods compute from one cloud alone: normals, descriptors, surfaces.
///
/// A cache belongs to one cloud; with another cloud its values are wrong. Results are the same bits
/// with and without a cache.
#[derive(Default)]
pub struct Cache(Mutex<Vec<Entry>>);

/// A cloud of a pair, with its cache if there is one.
#[derive(Clone, Copy)]
pub struct Cached<'a> {
    /// The cloud.
    pub cloud: &'a PointCloud,
    /// Cache of the cloud; `None`: nothing is cached.
    pub cache: Option<&'a Cache>,
}

/// A value that can be cached.
pub(super) trait HeapSize: Any + Send + Sync {
    /// Approximate size in bytes.
    fn bytes(&self) -> usize;
}

/// Most cached values per key type: values whose settings also depend on the partner cloud would
/// otherwise grow with the number of pairs. Chosen by hand.
const MAX_ENTRIES_PER_KEY_TYPE: usize = 4;

struct Entry {
    key: Box<dyn Any + Send>,
    slot: Arc<Mutex<Option<CachedValue>>>,
}

struct CachedValue {
    value: Arc<dyn Any + Send + Sync>,
    bytes: Box<dyn Fn() -> usize + Send>,
}

impl Cache {
    /// Approximate size of the cached values in bytes.
    pub fn bytes(&self) -> usize {
        // A value that another thread is computing is counted once it is finished.
        let of = |entry: &Entry| match entry.slot.try_lock() {
            Ok(made) => made.as_ref().map_or(0, |made| (made.bytes)()),
            Err(_) => 0,
        };
        lock(&self.0).iter().map(of).sum()
    }

    /// Returns the value cached under `key`, or computes it by `make` and caches it; errors are not
    /// cached.
    ///
    /// Within a [worker pool](par::worker_pool) a second caller waits while the first computes.
    /// Elsewhere it computes its own value: the first caller might be waiting for work of the
    /// second.
    pub(super) fn get_or_compute<K, T>(
        &self,
        key: K,
        make: impl FnOnce() -> Result<T>,
    ) -> Result<Arc<T>>
    where
        K: PartialEq + Send + 'static,
        T: HeapSize,
    {
        let slot = self.slot(key);
        let mut slot = match slot.try_lock() {
            Ok(slot) => slot,
            // A slot whose thread unwound before it finished is empty.
            Err(TryLockError::Poisoned(slot)) => slot.into_inner(),
            Err(TryLockError::WouldBlock) if par::in_worker() => lock(&slot),
            Err(TryLockError::WouldBlock) => return make().map(Arc::new),
        };
        let kept = slot.as_ref().and_then(|made| made.value.clone().downcast().ok());
        if let Some(kept) = kept {
            return Ok(kept);
        }
        let value = Arc::new(make()?);
        let weighed = value.clone();
        *slot =
            Some(CachedValue { value: value.clone(), bytes: Box::new(move || weighed.bytes()) });
        Ok(value)
    }

    /// Returns the slot of `key` and makes it the most recently used; evicts the least recently
    /// used slot of the key type if there are too many.
    fn slot<K: PartialEq + Send + 'static>(&self, key: K) -> Arc<Mutex<Option<CachedValue>>> {
        let mut entries = lock(&self.0);
        let of_kind = |entry: &Entry| entry.key.is::<K>();
        let entry = match entries.iter().position(|it| it.key.downcast_ref() == Some(&key)) {
            Some(at) => entries.remove(at),
            None => {
                if entries.iter().filter(|it| of_kind(it)).count() >= MAX_ENTRIES_PER_KEY_TYPE
                    && let Some(oldest) = entries.iter().position(of_kind)
                {
                    entries.remove(oldest);
                }
                Entry { key: Box::new(key), slot: Arc::default() }
            }
        };
        let slot = entry.slot.clone();
        entries.push(entry);
        slot
    }
}

impl<'a> Cached<'a> {
    /// Takes `cache` if there is none.
    pub(super) fn or_cache(self, cache: &'a Cache) -> Self {
        Cached { cache: self.cache.or(Some(cache)), ..self }
    }
}

impl<'a> From<&'a PointCloud> for Cached<'a> {
    fn from(cloud: &'a PointCloud) -> Self {
        Cached { cloud, cache: None }
    }
}

/// Key of a cloud's resolution.
#[derive(PartialEq)]
struct ResolutionKey;

impl HeapSize for f64 {
    fn bytes(&self) -> usize {
        size_of::<f64>()
    }
}

impl HeapSize for PointCloud {
    fn bytes(&self) -> usize {
        PointCloud::bytes(self)
    }
}

impl<'a> Cached<'a> {
    /// Replaces the cloud by `counting`, its points that count; the cache is kept only if these are
    /// all points.
    pub(super) fn restrict_to(self, counting: &'a PointCloud) -> Cached<'a> {
        match counting.len() == self.cloud.len() {
            true => self,
            false => counting.into(),
        }
    }

    /// Returns the cloud's value under `key`, cached or computed.
    pub(super) fn get_or_compute<K, T>(
        &self,
        key: K,
        make: impl FnOnce() -> Result<T>,
    ) -> Result<Arc<T>>
    where
        K: PartialEq + Send + 'static,
        T: HeapSize,
    {
        match self.cache {
            Some(cache) => cache.get_or_compute(key, make),
            None => make().map(Arc::new),
        }
    }

    /// Returns the cloud's [resolution](search::resolution).
    pub(super) fn resolution(&self) -> Result<f64> {
        self.get_or_compute(ResolutionKey, || search::resolution(self.cloud.points()))
            .map(|found| *found)
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;
    use crate::error::Error;

    impl HeapSize for String {
        fn bytes(&self) -> usize {
            self.len()
        }
    }

    #[test]
    fn what_was_made_is_not_made_again() {
        let (cache, made) = (Cache::default(), Cell::new(0));
        let get = |key: u32| {
            let make = || {
                made.set(made.get() + 1);
                Ok(key.to_string())
            };
            cache.get_or_compute(key, make).unwrap()
        };
        assert_eq!((get(10).as_str(), get(10).as_str(), made.get()), ("10", "10", 1));
        // Another key type with the same number.
        assert_eq!(*cache.get_or_compute(10u64, || Ok(String::from("other"))).unwrap(), "other");
        assert_eq!(cache.bytes(), 7);
        // The least recently used key of its type is evicted; the other key type is unchanged.
        for key in [11, 12, 13, 10, 14] {
            get(key);
        }
        assert_eq!((made.get(), cache.bytes()), (5, 13));
        get(11);
        assert_eq!(made.get(), 6);
        get(10);
        assert_eq!(made.get(), 6);
    }

    #[test]
    fn errors_are_not_kept_and_a_maker_that_ends_leaves_nothing() {
        let cache = Cache::default();
        let failed = cache.get_or_compute(1, || Err::<String, _>(Error::NO_WEIGHT));
        assert!(failed.is_err() && cache.bytes() == 0);
        let ended = || _ = cache.get_or_compute(1, || -> Result<String> { panic!("a bug") });
        assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(ended)).is_err());
        assert_eq!(*cache.get_or_compute(1, || Ok(String::from("made"))).unwrap(), "made");
    }

    #[test]
    fn outside_of_a_crew_nobody_waits() {
        let cache = Cache::default();
        let own = || Ok(String::from("own"));
        let outer = cache.get_or_compute(1, || {
            // As a loop would that the computing thread runs while it waits.
            assert_eq!(*cache.get_or_compute(1, own).unwrap(), "own");
            Ok(String::from("outer"))
        });
        assert_eq!(*outer.unwrap(), "outer");
        assert_eq!(*cache.get_or_compute(1, own).unwrap(), "outer");
    }
}
