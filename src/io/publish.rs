//! Destinations of a file, and files that appear whole or not at all.

use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

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
/// Until then an existing file of that name stays unchanged, even if the process is killed. If
/// writing fails, the temporary file is removed.
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
    file: BufWriter<NamedTempFile>,
    path: PathBuf,
}

impl AtomicFile {
    /// Begins a file that [`AtomicFile::commit`] moves to `path`.
    ///
    /// # Errors
    /// `Io` if its folder cannot be written; `Input` if there is a folder at `path`.
    pub fn create(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        if path.is_dir() {
            return Err(Error::input(format!("{} is a folder", path.display())));
        }
        let folder = folder_of(path);
        let mut builder = tempfile::Builder::new();
        builder.prefix(".").suffix(".tmp");
        #[cfg(unix)]
        {
            // The user's mask decides, as for any new file; temporary files would be private.
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        let file = builder
            .tempfile_in(folder)
            .map_err(|e| Error::io(format!("cannot write in {}", folder.display()), e))?;
        Ok(AtomicFile {
            file: BufWriter::with_capacity(1 << 18, file),
            path: path.to_owned(),
        })
    }

    /// The folder of the file.
    pub(crate) fn folder(&self) -> &Path {
        folder_of(&self.path)
    }

    /// Makes the file visible under its name, and replaces an existing one.
    ///
    /// # Errors
    /// `Io`; an existing file stays unchanged then.
    pub fn commit(self) -> Result<()> {
        let failed = |e| Error::io(format!("cannot write {}", self.path.display()), e);
        let file = self.file.into_inner().map_err(|e| failed(e.into_error()))?;
        // The bytes must be on storage before the name is: a crash may happen in between.
        file.as_file().sync_all().map_err(failed)?;
        file.persist(&self.path).map_err(|e| failed(e.error))?;
        Ok(())
    }
}

fn folder_of(path: &Path) -> &Path {
    let folder = path.parent().filter(|f| *f != Path::new(""));
    folder.unwrap_or(Path::new("."))
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}
