//! Publishing: whatever fails or panics, and wherever, the old file or the new one is whole.

use std::fs::{self, File};
use std::io::{self, Write};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use deepshadow::raw::{AtomicFile, FileSystem, remove_temporaries};
use deepshadow::*;

/// How a step goes wrong.
#[derive(Clone, Copy, Debug)]
enum Fault {
    Error,
    Panic,
}

/// The steps of a run in their order. One of them may go wrong.
#[derive(Debug, Default)]
struct Steps {
    /// Whether temporary files have names, as on systems that do not have others.
    named: bool,
    fault: Option<(usize, Fault)>,
    log: Mutex<Vec<&'static str>>,
}

impl Steps {
    fn take(&self, step: &'static str) -> io::Result<()> {
        let mut log = self.log.lock().unwrap();
        let at = log.len();
        log.push(step);
        drop(log);
        match self.fault {
            Some((k, Fault::Error)) if k == at => Err(io::Error::other("it goes wrong here")),
            // Unlike `panic!`, this prints nothing.
            Some((k, Fault::Panic)) if k == at => resume_unwind(Box::new("it panics here")),
            _ => Ok(()),
        }
    }

    fn log(&self) -> Vec<&'static str> {
        self.log.lock().unwrap().clone()
    }
}

#[derive(Debug)]
struct System;

impl FileSystem for System {}

/// A file system that records its steps.
#[derive(Debug)]
struct Recording(Arc<Steps>);

impl FileSystem for Recording {
    fn create_unnamed(&self, folder: &Path) -> io::Result<File> {
        if self.0.named {
            return Err(io::ErrorKind::Unsupported.into());
        }
        self.0.take("create")?;
        System.create_unnamed(folder)
    }

    fn create(&self, path: &Path) -> io::Result<File> {
        self.0.take("create")?;
        System.create(path)
    }

    fn read(&self, file: &File, bytes: &mut [u8]) -> io::Result<usize> {
        self.0.take("read")?;
        System.read(file, bytes)
    }

    fn write(&self, file: &File, bytes: &[u8]) -> io::Result<usize> {
        self.0.take("write")?;
        // Some systems write less than they are given.
        System.write(file, &bytes[..bytes.len().min(100_000)])
    }

    fn sync(&self, file: &File) -> io::Result<()> {
        self.0.take("sync")?;
        System.sync(file)
    }

    fn link(&self, file: &File, path: &Path) -> io::Result<()> {
        self.0.take("link")?;
        System.link(file, path)
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.0.take("rename")?;
        System.rename(from, to)
    }

    fn sync_folder(&self, folder: &Path) -> io::Result<()> {
        self.0.take("sync the folder")?;
        System.sync_folder(folder)
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        self.0.take("remove")?;
        System.remove(path)
    }
}

/// A folder with an old file.
struct Place {
    folder: tempfile::TempDir,
    path: PathBuf,
}

impl Place {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.dsm");
        fs::write(&path, b"old").unwrap();
        Place { folder, path }
    }

    fn others(&self) -> Vec<String> {
        let entries = fs::read_dir(self.folder.path()).unwrap();
        let names = entries.map(|e| e.unwrap().file_name().into_string().unwrap());
        names.filter(|name| name != "a.dsm").collect()
    }
}

/// Runs `work` with a fault at each of its steps, by error and by panic, on both kinds of systems.
/// `work` publishes to a path, and returns whether the last call succeeded; `None` for a panic.
fn break_every_step(work: impl Fn(Arc<Steps>, &Path) -> Option<bool>) {
    for named in [cfg!(not(target_os = "linux")), true] {
        let place = Place::new();
        let whole = Arc::new(Steps {
            named,
            ..Steps::default()
        });
        assert_eq!(work(whole.clone(), &place.path), Some(true));
        let new = fs::read(&place.path).unwrap();
        assert_eq!(place.others(), [""; 0]);
        let log = whole.log();
        for k in 0..log.len() {
            for fault in [Fault::Error, Fault::Panic] {
                let place = Place::new();
                let steps = Arc::new(Steps {
                    named,
                    fault: Some((k, fault)),
                    ..Steps::default()
                });
                let good = work(steps.clone(), &place.path);
                let steps = steps.log();
                let about = format!("{fault:?} at step {k} ({}): {steps:?}", steps[k]);
                let found = fs::read(&place.path).unwrap();
                let is_new = found == new;
                assert!(is_new || found == b"old", "{} bytes: {about}", found.len());
                // Where files without a name fail, others do. A scratch file may keep its name.
                let harmless = match (steps[k], fault) {
                    ("remove", Fault::Error) => true,
                    ("create", Fault::Error) => is_new,
                    _ => false,
                };
                assert_eq!(good == Some(true), harmless, "{good:?}, {about}");
                assert_eq!(is_new, harmless || steps[k] == "sync the folder", "{about}");
                assert_eq!(place.others(), [""; 0], "{about}");
            }
        }
    }
}

/// Steep functions that compress badly, so that a file has several writes.
fn curves(tile: u32) -> Pixels {
    let curve = |i: u32| {
        let z = (0..12).map(|k| 1.0 + k as f32 + (i * 7 + tile * 13) as f32 / 4096.0);
        let v = (0..12).map(|k| 1.0 - f64::from(k * k + (i + tile) % 7 + 1) / 2000.0);
        Curve::mono(z.collect(), v.collect()).unwrap()
    };
    Pixels::Curves((0..32 * 32).map(curve).collect())
}

/// Calls `call` as a program does that ignores errors and survives panics.
fn carelessly<T>(call: impl FnOnce() -> Result<T>) -> Option<bool> {
    let result = catch_unwind(AssertUnwindSafe(call));
    result.ok().map(|result| result.is_ok())
}

#[test]
fn a_writer_publishes_the_whole_file_or_nothing() {
    break_every_step(|steps, path| {
        let system = Arc::new(Recording(steps.clone()));
        let writer = catch_unwind(|| Writer::create_on(system, path));
        let mut writer = match writer {
            Err(_) => return None,
            Ok(Err(_)) => return Some(false),
            Ok(Ok(writer)) => writer,
        };
        writer.set_budget(1 << 22);
        let held = Encoding::new(0.001).codec(Codec::None);
        let map = writer.add_map(MapHeader::new("m", 128, 64), held).unwrap();
        writer.set_budget(1); // all quarters go to scratch storage
        writer.on_progress(move |_, _| steps.take("callback").is_ok());
        // The last tile of each row of four is not given.
        for tile in [0, 4, 1, 5, 2, 6] {
            let id = TileId::new(tile % 4, tile / 4);
            carelessly(|| writer.tile(map, id, curves(tile)));
        }
        carelessly(|| writer.finish())
    });
}

#[test]
fn a_careless_caller_never_publishes_a_gap() {
    break_every_step(|steps, path| {
        let system = Arc::new(Recording(steps));
        let file = catch_unwind(|| AtomicFile::create_on(system, path));
        let mut file = match file {
            Err(_) => return None,
            Ok(Err(_)) => return Some(false),
            Ok(Ok(file)) => file,
        };
        for piece in 0..8u8 {
            carelessly(|| Ok(file.write_all(&[piece; 100_000])?));
        }
        carelessly(|| Ok(file.flush()?));
        carelessly(|| file.commit())
    });
}

/// A file in memory whose reads are steps.
struct Source(Vec<u8>, Arc<Steps>);

impl ReadAt for Source {
    fn length(&self) -> u64 {
        self.0.len() as u64
    }

    fn read_exact_at(&self, buffer: &mut [u8], offset: u64) -> io::Result<()> {
        self.1.take("read a source")?;
        buffer.copy_from_slice(&self.0[offset as usize..][..buffer.len()]);
        Ok(())
    }
}

#[test]
fn a_join_publishes_the_whole_file_or_nothing() {
    let part = |x: i32| {
        let mut writer = Writer::in_memory();
        let mut header = MapHeader::new("m", 64, 32);
        header.data_origin = [x, 0];
        let map = writer.add_map(header, Encoding::new(0.001)).unwrap();
        for tile in 0..2 {
            let id = TileId::new(tile, 0);
            writer.tile(map, id, curves(tile)).unwrap();
        }
        writer.into_bytes().unwrap()
    };
    let parts = [part(0), part(64)];
    let open = |steps: &Arc<Steps>, part: usize| {
        let source = Arc::new(Source(parts[part].clone(), steps.clone()));
        let file = DsmFile::from_source(source, Limits::default());
        file.map(|file| (part.to_string(), file))
    };
    for stitch in [true, false] {
        break_every_step(|steps, path| {
            let second = usize::from(stitch);
            let opened = catch_unwind(|| Ok(vec![open(&steps, 0)?, open(&steps, second)?]));
            let files = match opened {
                Err(_) => return None,
                Ok(Err::<_, Error>(_)) => return Some(false),
                Ok(Ok(files)) => files,
            };
            let mut writer = Writer::create(path).unwrap();
            carelessly(|| match stitch {
                true => Join::stitch(files)?.write(&mut writer, &[Encoding::default()]),
                false => Join::merge(files)?.write(&mut writer, &[Encoding::new(0.1)]),
            });
            carelessly(|| writer.finish())
        });
    }
}

#[test]
fn a_stream_that_cannot_be_flushed_is_an_error() {
    struct Stream;
    impl Write for Stream {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            Ok(bytes.len())
        }
        fn flush(&mut self) -> io::Result<()> {
            Err(io::ErrorKind::StorageFull.into())
        }
    }
    let mut writer = Writer::new(Stream).unwrap();
    let header = MapHeader::new("m", 8, 8);
    writer.add_map(header, Encoding::default()).unwrap();
    assert_eq!(writer.finish().unwrap_err().kind(), ErrorKind::Io);
}

#[test]
fn contents_reach_the_storage_before_the_name_and_the_name_before_the_end() {
    for (named, end) in [
        (true, &["sync", "rename", "sync the folder"][..]),
        (false, &["sync", "link", "rename", "sync the folder"]),
    ] {
        if !named && cfg!(not(target_os = "linux")) {
            continue;
        }
        let place = Place::new();
        let steps = Arc::new(Steps {
            named,
            ..Steps::default()
        });
        let system = Arc::new(Recording(steps.clone()));
        let mut file = AtomicFile::create_on(system, &place.path).unwrap();
        file.write_all(&[7; 1_000_000]).unwrap();
        file.commit().unwrap();
        let log = steps.log();
        assert_eq!(log[0], "create");
        let writes = log.len() - 1 - end.len();
        assert!(writes >= 10 && log[1..][..writes].iter().all(|s| *s == "write"));
        assert_eq!(log[1 + writes..], *end);
    }
}

#[test]
fn a_refused_batch_of_tiles_changes_nothing() {
    let lit = |n| Pixels::Curves(vec![Curve::lit(1); n]);
    let dark = |n| Pixels::Curves(vec![Curve::mono(vec![1.0], vec![0.0]).unwrap(); n]);
    let mut writer = Writer::in_memory();
    let header = MapHeader::new("m", 64, 32);
    let map = writer.add_map(header, Encoding::default()).unwrap();
    let [left, right] = [0, 1].map(|x| TileId::new(x, 0));
    let batch = vec![(left, dark(1024)), (right, lit(7))];
    assert_eq!(
        writer.tiles(map, batch).unwrap_err().kind(),
        ErrorKind::Input
    );
    writer.tiles(map, vec![(left, dark(1024))]).unwrap();
    let file = DsmFile::from_bytes(writer.into_bytes().unwrap()).unwrap();
    let pixel = file.function(map.level(0), Pixel::new(3, 3)).unwrap();
    assert_eq!(pixel.visibility(2.0), 0.0);
}

#[test]
fn a_pixel_given_twice_or_in_colour_is_refused_at_once() {
    let mut writer = Writer::in_memory();
    let mut header = MapHeader::new("m", 8, 8).tile_size(8);
    header.channels = 1;
    let map = writer.add_map(header, Encoding::default()).unwrap();
    let dark = Curve::mono(vec![1.0], vec![0.0]).unwrap();
    let red = Curve::from_planes(vec![1.0], vec![vec![0.5], vec![1.0], vec![1.0]]).unwrap();
    let all = (0..64).map(|i| Pixel::new(i % 8, i / 8));
    for pixel in all.clone() {
        assert!(writer.pixel(map, pixel, &red).is_err());
        writer.pixel(map, pixel, &dark).unwrap();
        let twice = writer.pixel(map, pixel, &dark).unwrap_err();
        assert!(twice.to_string().contains("given before"), "{twice}");
    }
    let file = DsmFile::from_bytes(writer.into_bytes().unwrap()).unwrap();
    for pixel in all {
        let function = file.function(map.level(0), pixel).unwrap();
        assert_eq!(function.visibility(2.0), 0.0);
    }
}

fn publish(path: &Path, text: &str) -> Result<()> {
    let mut file = AtomicFile::create(path)?;
    file.write_all(text.as_bytes())?;
    file.commit()
}

#[test]
fn long_names_and_a_slash_at_the_end_are_no_obstacle() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["x".repeat(255), "\u{1f311}".repeat(63), "map.dsm/".into()] {
        let path = folder.path().join(name);
        for named in [true, false] {
            let steps = Arc::new(Steps {
                named,
                ..Steps::default()
            });
            let file = AtomicFile::create_on(Arc::new(Recording(steps)), &path).unwrap();
            file.commit().unwrap();
        }
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3);
}

const CHILD: &str = "DSM_PUBLISH_CHILD";

/// The child process of [`temporary_files_are_removed_on_request`]; does nothing by itself.
#[test]
fn child_removes_its_temporary_files() {
    let Some(folder) = std::env::var_os(CHILD) else {
        return;
    };
    let folder = Path::new(&folder);
    let count = || fs::read_dir(folder).unwrap().count();
    let steps = Arc::new(Steps {
        named: true,
        ..Steps::default()
    });
    let system = Arc::new(Recording(steps));
    let create = |name| AtomicFile::create_on(system.clone(), folder.join(name)).unwrap();
    let [mut one, two, gone] = ["one", "two", "gone"].map(create);
    let names = fs::read_dir(folder).unwrap();
    let names: Vec<_> = names.map(|e| e.unwrap().file_name()).collect();
    let names: Vec<_> = names.iter().map(|n| n.to_str().unwrap()).collect();
    for output in ["one", "two", "gone"] {
        let is_named = |n: &&str| n.starts_with(&format!(".{output}.")) && n.ends_with(".part");
        assert_eq!(names.iter().filter(|n| is_named(n)).count(), 1, "{names:?}");
    }
    drop(gone);
    two.commit().unwrap();
    assert_eq!(count(), 2);
    drop(remove_temporaries());
    assert_eq!(count(), 1);
    one.write_all(b"1").unwrap();
    assert_eq!(one.commit().unwrap_err().kind(), ErrorKind::Io);
    assert_eq!(count(), 1);
}

#[test]
fn temporary_files_are_removed_on_request() {
    let folder = tempfile::tempdir().unwrap();
    let child = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "publish::child_removes_its_temporary_files"])
        .env(CHILD, folder.path())
        .output()
        .unwrap();
    assert!(child.status.success(), "{child:?}");
    assert_eq!(fs::read(folder.path().join("two")).unwrap(), b"");
}

#[cfg(unix)]
mod unix {
    use super::*;
    use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt, chown, symlink};

    #[test]
    fn symbolic_links_stay_and_their_target_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("there")).unwrap();
        fs::write(at("there/file"), "old").unwrap();
        symlink("there/file", at("relative")).unwrap();
        symlink(at("relative"), at("chain")).unwrap();
        symlink("there/new", at("dangling")).unwrap();
        for (link, target) in [
            ("relative", "there/file"),
            ("chain", "there/file"),
            ("dangling", "there/new"),
        ] {
            publish(&at(link), link).unwrap();
            assert!(fs::symlink_metadata(at(link)).unwrap().is_symlink());
            assert_eq!(fs::read_to_string(at(target)).unwrap(), link);
        }
        assert_eq!(fs::read_dir(at("there")).unwrap().count(), 2);
        symlink("loop", at("loop")).unwrap();
        let error = publish(&at("loop"), "").unwrap_err();
        assert!(error.to_string().contains("leads back"), "{error}");
    }

    #[test]
    fn permissions_and_owner_of_the_replaced_file_stay() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        for mode in [0o600, 0o640, 0o444, 0o755] {
            fs::write(&path, "old").unwrap();
            fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
            // Only root may give a file away.
            let given = chown(&path, Some(1234), Some(5678)).is_ok();
            let old = fs::metadata(&path).unwrap();
            publish(&path, "new").unwrap();
            let new = fs::metadata(&path).unwrap();
            assert_eq!(new.mode(), old.mode(), "{mode:o}");
            assert_eq!((new.uid(), new.gid()), (old.uid(), old.gid()));
            assert!(!given || new.uid() == 1234);
            assert_ne!(new.ino(), old.ino(), "it was written in place");
            fs::remove_file(&path).unwrap();
        }
    }

    #[test]
    fn a_new_file_has_the_permissions_of_any_new_file() {
        let folder = tempfile::tempdir().unwrap();
        let [ours, plain] = ["ours", "plain"].map(|name| folder.path().join(name));
        publish(&ours, "").unwrap();
        fs::write(&plain, "").unwrap();
        let mode = |path| fs::metadata(path).unwrap().mode();
        assert_eq!(mode(ours), mode(plain));
    }

    #[test]
    fn only_a_file_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let made = std::process::Command::new("mkfifo")
            .arg(at("pipe"))
            .status();
        assert!(made.unwrap().success());
        let _socket = std::os::unix::net::UnixListener::bind(at("socket")).unwrap();
        fs::create_dir(at("folder")).unwrap();
        symlink("/dev/null", at("link")).unwrap();
        let paths = [at("pipe"), at("socket"), at("folder"), at("link")];
        for path in paths.iter().chain([&PathBuf::from("/dev/full")]) {
            let error = publish(path, "x").unwrap_err();
            assert_eq!(error.kind(), ErrorKind::Input);
            let text = error.to_string();
            assert!(text.contains(" is a "), "{text}");
            assert!(text.contains(&*path.to_string_lossy()), "{text}");
        }
        let kind = |name| fs::symlink_metadata(at(name)).unwrap().file_type();
        assert!(kind("pipe").is_fifo() && kind("socket").is_socket());
        assert!(kind("folder").is_dir() && kind("link").is_symlink());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 4);
    }

    #[test]
    fn errors_name_the_output() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("missing/a.dsm");
        let error = Writer::create(&path).unwrap_err().to_string();
        assert!(
            error.contains("missing") && !error.contains(".part"),
            "{error}"
        );
        let steps = Steps {
            named: true,
            fault: Some((2, Fault::Error)),
            ..Steps::default()
        };
        let path = folder.path().join("a.dsm");
        let system = Arc::new(Recording(Arc::new(steps)));
        let mut file = AtomicFile::create_on(system, &path).unwrap();
        file.write_all(b"x").unwrap();
        let error = file.commit().unwrap_err().to_string();
        assert!(
            error.contains("cannot write") && !error.contains(".part"),
            "{error}"
        );
        assert!(
            error.contains("a.dsm") && error.contains("goes wrong"),
            "{error}"
        );
    }
}
