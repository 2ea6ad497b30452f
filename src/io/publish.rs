//! Destinations of a file, and files that appear whole or not at all.

use std::fs;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::temporary::{FileSystem, System, Temporary, folder_of};
use crate::{Error, Result};

/// The destination of a file that is being written.
pub(crate) enum Output {
    Memory(Vec<u8>),
    Stream(Box<dyn Write + Send>),
    File(AtomicFile),
}

impl Output {
    pub fn write_all(&mut self, bytes: &[u8]) -> Result<()> {
        let out: &mut dyn Write = match self {
            Output::Memory(out) => out,
            Output::Stream(out) => out,
            Output::File(out) => out,
        };
        out.write_all(bytes).map_err(failed)
    }

    /// Makes the complete file visible. Returns its bytes if it is in memory.
    pub fn commit(self) -> Result<Vec<u8>> {
        match self {
            Output::Memory(bytes) => return Ok(bytes),
            Output::Stream(mut out) => out.flush().map_err(failed)?,
            Output::File(out) => out.commit()?,
        }
        Ok(Vec::new())
    }
}

fn failed(e: io::Error) -> Error {
    Error::io("cannot write the file", e)
}

/// A file that is written under a temporary name in its folder, and renamed when it is complete.
///
/// Until then an existing file of that name stays unchanged, even if the process is killed or the
/// power fails. The new file has the permissions of the file that it replaces, and its owner and
/// group where the system allows that. Symbolic links are followed: the link stays.
///
/// On Linux the temporary file has no name, so that nothing remains of a killed process. Elsewhere,
/// and on file systems without such files, its name is `.OUTPUT.XXXXXXXX.part`. If writing fails,
/// it is removed.
///
/// ```
/// use std::io::Write;
/// # fn main() -> deepshadow::Result<()> {
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = folder.path().join("out.txt");
/// let mut file = deepshadow::raw::AtomicFile::create(&path)?;
/// file.write_all(b"whole")?;
/// assert!(!path.exists());
/// file.commit()?;
/// assert_eq!(std::fs::read(&path)?, b"whole");
/// # Ok(()) }
/// ```
#[derive(Debug)]
pub struct AtomicFile {
    file: BufWriter<Temporary>,
    /// Path of the file to replace, which is no symbolic link.
    path: PathBuf,
}

impl AtomicFile {
    /// Begins a file that [`AtomicFile::commit`] moves to `path`.
    ///
    /// # Errors
    /// `Io` if its folder cannot be written; `Input` if `path` is a folder, a device, a pipe or a
    /// socket.
    pub fn create(path: impl AsRef<Path>) -> Result<Self> {
        Self::create_on(Arc::new(System), path)
    }

    /// As [`AtomicFile::create`], with the operations of `system`.
    ///
    /// # Errors
    /// As [`AtomicFile::create`].
    pub fn create_on(system: Arc<dyn FileSystem>, path: impl AsRef<Path>) -> Result<Self> {
        let path = to_replace(path.as_ref())?;
        let cannot = |e| Error::io(format!("cannot write in {}", folder_of(&path).display()), e);
        let file = Temporary::create(system, &path).map_err(cannot)?;
        Ok(AtomicFile {
            file: BufWriter::with_capacity(1 << 18, file),
            path,
        })
    }

    /// The folder of the file.
    pub(crate) fn folder(&self) -> &Path {
        folder_of(&self.path)
    }

    /// Makes the file visible under its name, and replaces an existing one.
    ///
    /// # Errors
    /// `Io`, also if an earlier write failed. An existing file stays unchanged then, unless only
    /// its folder cannot be synced.
    pub fn commit(self) -> Result<()> {
        let path = self.path;
        let cannot = |e| Error::io(format!("cannot write {}", path.display()), e);
        let file = self.file.into_inner().map_err(|e| cannot(e.into_error()))?;
        file.publish(&path).map_err(cannot)?.map_err(|e| {
            let line = format!(
                "{} is complete, but a power failure may undo it",
                path.display()
            );
            Error::io(line, e)
        })
    }
}

/// The path to replace when a file is written to `path`: symbolic links are followed.
fn to_replace(path: &Path) -> Result<PathBuf> {
    let refused = |what| Err(Error::input(format!("{} is {what}", path.display())));
    match fs::metadata(path) {
        Ok(found) if found.is_dir() => return refused("a folder"),
        Ok(found) if !found.is_file() => {
            return refused("a device, a pipe or a socket, not a file");
        }
        _ => {}
    }
    // Drops a slash at the end.
    let mut target: PathBuf = path.components().collect();
    for _ in 0..40 {
        match fs::read_link(&target) {
            Ok(to) => target = folder_of(&target).join(to),
            Err(_) => return Ok(target),
        }
    }
    refused("a symbolic link that leads back to itself")
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Seek for AtomicFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}
