//! The cache against a model that holds every tile.

use std::collections::HashSet;
use std::path::PathBuf;
use std::sync::Arc;

use crate::cache_support::{BOOKKEEPING, Model, WAYS, everything, nearest, pixel};
use crate::random::Random;
use deepshadow::*;

/// A file in the cache: its number, and the index of the stored file.
#[derive(Clone)]
struct Open {
    id: usize,
    kind: usize,
    file: CachedFile,
}

struct Worker {
    open: Open,
    map: usize,
    sampler: Sampler,
    last: (u32, u32),
}

/// A cache under test, its users, and what the model expects.
struct World<'a> {
    stored: &'a [(PathBuf, Vec<u8>, Model)],
    random: Random,
    cache: Arc<TileCache>,
    files: Vec<Open>,
    workers: Vec<Worker>,
    added: usize,
    lookups: u64,
    most_budget: usize,
    most_tables: usize,
    most_workers: usize,
}

impl World<'_> {
    fn add_file(&mut self) {
        let kind = self.random.index(self.stored.len());
        let (path, bytes, _) = &self.stored[kind];
        let file = match self.random.index(3) {
            0 => DsmFile::from_bytes(bytes.clone()),
            1 => DsmFile::open(path),
            // SAFETY: only this test knows the file, and it does not write to it.
            #[cfg(feature = "mmap")]
            _ => unsafe { DsmFile::open_mmap(path) },
            #[cfg(not(feature = "mmap"))]
            _ => DsmFile::open(path),
        };
        self.added += 1;
        self.files.push(Open {
            id: self.added,
            kind,
            file: self.cache.add(file.unwrap()),
        });
    }

    fn add_worker(&mut self) {
        if self.files.is_empty() || self.workers.len() == 6 {
            return;
        }
        let at = self.random.index(self.files.len());
        let open = self.files[at].clone();
        let map = self.random.index(2);
        self.workers.push(Worker {
            sampler: nearest(&open.file, map, OnError::Fail),
            open,
            map,
            last: (0, 0),
        });
        self.most_workers = self.most_workers.max(self.workers.len());
    }

    fn look_up(&mut self) {
        if self.workers.is_empty() {
            return;
        }
        let at = self.random.index(self.workers.len());
        let worker = &mut self.workers[at];
        let model = &self.stored[worker.open.kind].2;
        let level = self.random.index(model.levels(worker.map));
        let shape = model.shape(worker.map, level);
        for _ in 0..1 + self.random.index(4) {
            worker.last = self.random.pixel(shape, worker.last);
            let depth = self.random.depth();
            let query = pixel(level, worker.last, depth);
            let answer = worker.sampler.visibility_rgb(&query).unwrap();
            let expected = model.answer(worker.map, level, worker.last, depth);
            assert_eq!(
                answer.map(f32::to_bits),
                expected.map(f32::to_bits),
                "{query:?}: {answer:?}, not {expected:?}"
            );
            self.lookups += 1;
        }
    }

    /// Bytes of the tables that the cache may hold: those of files with a handle.
    fn table_bytes(&mut self) -> usize {
        let workers = self.workers.iter().map(|w| &w.open);
        let open: HashSet<(usize, usize)> = self
            .files
            .iter()
            .chain(workers)
            .map(|o| (o.id, o.kind))
            .collect();
        let tables = open.iter().map(|o| self.stored[o.1].2.tables()).sum();
        self.most_tables = self.most_tables.max(tables);
        tables
    }

    fn set_budget(&mut self) {
        let budget = [0, 1 << 10, 40 << 10, 100 << 10, 400 << 10, 16 << 20][self.random.index(6)];
        self.most_budget = self.most_budget.max(budget);
        self.cache.set_budget(budget);
        assert_eq!(self.cache.budget(), budget);
    }

    /// Releases every tile, and checks that the cache is within its budget.
    ///
    /// Only tables may exceed it: they stay as long as their files.
    fn release_all(&mut self) {
        self.workers.iter_mut().for_each(|w| w.sampler.release());
        let (stats, tables) = (self.cache.stats(), self.table_bytes());
        assert!(
            stats.bytes <= self.cache.budget().max(tables),
            "{} bytes of tables in\n{stats}",
            tables
        );
        assert_eq!(stats.hits + stats.misses, self.lookups, "{stats}");
        assert!(stats.loads <= stats.misses && stats.redundant_loads <= stats.loads);
    }

    fn step(&mut self) {
        match self.random.index(100) {
            0 if self.files.len() < 4 => self.add_file(),
            1 if !self.files.is_empty() => {
                let at = self.random.index(self.files.len());
                self.files.swap_remove(at);
            }
            2..=4 => self.add_worker(),
            5 if !self.workers.is_empty() => {
                let at = self.random.index(self.workers.len());
                self.workers.swap_remove(at);
            }
            6 if !self.workers.is_empty() => {
                let at = self.random.index(self.workers.len());
                self.workers[at].sampler.release();
            }
            7 => self.set_budget(),
            8 => self.cache.clear(),
            9 => self.release_all(),
            _ => self.look_up(),
        }
        self.table_bytes();
    }
}

#[test]
fn answers_equal_those_of_the_decoded_tiles_whatever_happens_in_between() {
    let folder = tempfile::tempdir().unwrap();
    let stored: Vec<_> = WAYS
        .into_iter()
        .enumerate()
        .map(|(i, way)| {
            let path = folder.path().join(format!("{i}.dsm"));
            let bytes = everything(way);
            std::fs::write(&path, &bytes).unwrap();
            (path, bytes.clone(), Model::new(bytes))
        })
        .collect();
    let largest = stored.iter().map(|s| s.2.largest()).max().unwrap();
    for seed in 0..12 {
        let mut world = World {
            stored: &stored,
            random: Random(seed),
            cache: TileCache::new(64 << 10),
            files: Vec::new(),
            workers: Vec::new(),
            added: 0,
            lookups: 0,
            most_budget: 64 << 10,
            most_tables: 0,
            most_workers: 0,
        };
        world.add_file();
        world.add_worker();
        for _ in 0..3000 {
            world.step();
        }
        world.release_all();
        assert!(world.lookups > 1000);
        // A sampler pins at most 64 tiles; a recycled buffer may be twice as large as its tile.
        let tile = 2 * largest + BOOKKEEPING;
        let peak = world.most_budget + world.most_tables + (64 * world.most_workers + 1) * tile;
        let stats = world.cache.stats();
        assert!(
            stats.peak_bytes <= peak,
            "{peak} bytes are allowed\n{stats}"
        );
        world.files.clear();
        world.workers.clear();
        world.cache.clear();
        let stats = world.cache.stats();
        assert_eq!(
            stats.bytes, 0,
            "after all files and samplers are dropped\n{stats}"
        );
        assert_eq!(stats.hits + stats.misses, world.lookups, "{stats}");
    }
}
