//! Temporary files, and the operations of the file system that write and publish them.

use std::fmt::Debug;
use std::fs::{self, File, OpenOptions};
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::{self, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The operations by which a file is written and published.
///
/// The provided methods are the operations of the system. A test overrides them, to record their
/// order or to make them fail.
pub trait FileSystem: Debug + Send + Sync {
    /// Creates a file in `folder` that has no name until [`FileSystem::link`] gives it one.
    ///
    /// # Errors
    /// Any, if the system or the folder does not have such files.
    fn create_unnamed(&self, folder: &Path) -> io::Result<File> {
        // `link` needs the second folder.
        #[cfg(target_os = "linux")]
        if Path::new("/proc/self/fd").exists() {
            use std::os::unix::fs::OpenOptionsExt;
            let flag = rustix::fs::OFlags::TMPFILE.bits() as i32;
            let mut options = OpenOptions::new();
            return options
                .read(true)
                .write(true)
                .custom_flags(flag)
                .open(folder);
        }
        Err(io::Error::other(format!(
            "{folder:?} has only files with a name"
        )))
    }

    /// Creates a file at `path`, where there is none.
    ///
    /// # Errors
    /// Those of the system.
    fn create(&self, path: &Path) -> io::Result<File> {
        let mut options = OpenOptions::new();
        options.read(true).write(true).create_new(true).open(path)
    }

    /// Reads bytes.
    ///
    /// # Errors
    /// Those of the system.
    fn read(&self, mut file: &File, bytes: &mut [u8]) -> io::Result<usize> {
        file.read(bytes)
    }

    /// Writes bytes.
    ///
    /// # Errors
    /// Those of the system.
    fn write(&self, mut file: &File, bytes: &[u8]) -> io::Result<usize> {
        file.write(bytes)
    }

    /// Waits until the contents are on storage.
    ///
    /// # Errors
    /// Those of the system.
    fn sync(&self, file: &File) -> io::Result<()> {
        file.sync_all()
    }

    /// Gives a file of [`FileSystem::create_unnamed`] the name `path`, where there is none.
    ///
    /// # Errors
    /// Those of the system.
    fn link(&self, file: &File, path: &Path) -> io::Result<()> {
        #[cfg(target_os = "linux")]
        {
            use rustix::fs::{AtFlags, CWD, linkat};
            let from = format!("/proc/self/fd/{}", std::os::fd::AsRawFd::as_raw_fd(file));
            Ok(linkat(CWD, from, CWD, path, AtFlags::SYMLINK_FOLLOW)?)
        }
        #[cfg(not(target_os = "linux"))]
        Err(io::Error::other(format!(
            "{file:?} has a name, not {path:?}"
        )))
    }

    /// Renames a file, and replaces an existing one.
    ///
    /// # Errors
    /// Those of the system.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        fs::rename(from, to)
    }

    /// Waits until the names in a folder are on storage.
    ///
    /// # Errors
    /// Those of the system, unless it cannot sync this folder at all.
    fn sync_folder(&self, folder: &Path) -> io::Result<()> {
        use ErrorKind::{InvalidInput, PermissionDenied, Unsupported};
        // Windows opens no folder.
        let synced = File::open(folder).and_then(|folder| folder.sync_all());
        synced.or_else(|e| match e.kind() {
            InvalidInput | PermissionDenied | Unsupported => Ok(()),
            _ => Err(e),
        })
    }

    /// Removes a file.
    ///
    /// # Errors
    /// Those of the system.
    fn remove(&self, path: &Path) -> io::Result<()> {
        fs::remove_file(path)
    }
}

/// The system's own operations.
#[derive(Debug)]
pub(super) struct System;

impl FileSystem for System {}

/// Names of the temporary files of this process. Locked while a name appears or disappears.
static NAMES: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

fn names() -> MutexGuard<'static, Vec<PathBuf>> {
    NAMES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Removes the temporary files of all unfinished outputs. No other appears, and none is published,
/// until the result is dropped: a program that a signal ends calls this, and then ends.
#[must_use = "files appear again after the result is dropped"]
pub fn remove_temporaries() -> impl Sized {
    let names = names();
    names.iter().for_each(|name| drop(fs::remove_file(name)));
    names
}

/// A file without a name, or with a temporary one. It disappears unless it is published.
#[derive(Debug)]
pub(super) struct Temporary {
    system: Arc<dyn FileSystem>,
    file: File,
    name: Option<PathBuf>,
    /// Whether a write is in progress, or has failed.
    failed: bool,
}

impl Temporary {
    /// A file in the folder of `output`.
    pub fn create(system: Arc<dyn FileSystem>, output: &Path) -> io::Result<Self> {
        let (file, name) = match system.create_unnamed(folder_of(output)) {
            Ok(file) => (file, None),
            Err(_) => {
                let (name, file) = with_name(output, |name| system.create(name))?;
                (file, Some(name))
            }
        };
        Ok(Temporary {
            system,
            file,
            name,
            failed: false,
        })
    }

    /// A file in `folder` that is not published. It has no name if the system can remove the name
    /// of an open file.
    pub fn scratch(system: Arc<dyn FileSystem>, folder: &Path) -> io::Result<Self> {
        let mut file = Self::create(system, &folder.join("scratch"))?;
        file.remove();
        Ok(file)
    }

    /// Moves the file to `path`, and replaces an existing one. Returns whether its folder could be
    /// synced.
    pub fn publish(mut self, path: &Path) -> io::Result<io::Result<()>> {
        if self.failed {
            return Err(io::Error::other("an earlier write failed"));
        }
        #[cfg(unix)]
        if let Ok(old) = fs::metadata(path) {
            self.resemble(&old);
        }
        // The bytes must be on storage before the name is: the power may fail in between.
        self.system.sync(&self.file)?;
        let name = match self.name.take() {
            Some(name) => name,
            None => with_name(path, |name| self.system.link(&self.file, name))?.0,
        };
        let from = self.name.insert(name);
        let mut names = names();
        self.system.rename(from, path)?;
        names.retain(|name| name != from);
        self.name = None;
        drop(names);
        Ok(self.system.sync_folder(folder_of(path)))
    }

    /// Takes over permissions, and owner and group where the system allows it.
    #[cfg(unix)]
    fn resemble(&self, old: &fs::Metadata) {
        use std::os::unix::fs::{MetadataExt, PermissionsExt, fchown};
        let _ = fchown(&self.file, Some(old.uid()), Some(old.gid()))
            .or_else(|_| fchown(&self.file, None, Some(old.gid())));
        let mode = fs::Permissions::from_mode(old.mode() & 0o777);
        let _ = self.file.set_permissions(mode);
    }

    fn remove(&mut self) {
        let mut names = names();
        if let Some(name) = self.name.take_if(|name| self.system.remove(name).is_ok()) {
            names.retain(|other| *other != name);
        }
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        self.remove();
    }
}

/// Calls `make` with names `.OUTPUT.XXXXXXXX.part` until one is free.
fn with_name<T>(output: &Path, make: impl Fn(&Path) -> io::Result<T>) -> io::Result<(PathBuf, T)> {
    let name = output.file_name().unwrap_or_default().to_string_lossy();
    // A name has at most 255 bytes, and a character up to four.
    let name: String = name.chars().take(56).collect();
    loop {
        let random = RandomState::new().build_hasher().finish() as u32;
        let path = folder_of(output).join(format!(".{name}.{random:08x}.part"));
        let mut names = names();
        match make(&path) {
            Err(e) if e.kind() == ErrorKind::AlreadyExists => {}
            made => {
                let made = made?;
                names.push(path.clone());
                return Ok((path, made));
            }
        }
    }
}

/// The folder of a file.
pub(super) fn folder_of(path: &Path) -> &Path {
    let folder = path.parent().filter(|f| *f != Path::new(""));
    folder.unwrap_or(Path::new("."))
}

impl Read for Temporary {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.system.read(&self.file, bytes)
    }
}

impl Write for Temporary {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let failed = std::mem::replace(&mut self.failed, true);
        let written = self.system.write(&self.file, bytes);
        let is_failure = |e: &io::Error| e.kind() != ErrorKind::Interrupted;
        self.failed = failed || written.as_ref().is_err_and(is_failure);
        written
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for Temporary {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}
