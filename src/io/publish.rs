//! Files that appear whole or not at all.

use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use crate::{Error, Result};

/// The destination of a file that is being written.
pub(crate) enum Output {
    /// A vector.
    Memory(Vec<u8>),
    /// The caller's own writer.
    Stream(Box<dyn Write + Send>),
    /// A file of the system.
    File(AtomicFile),
}

impl Output {
    pub fn write_all(&mut self, bytes: &[u8]) -> Result<()> {
        let written = match self {
            Output::Memory(out) => out.write_all(bytes),
            Output::Stream(out) => out.write_all(bytes),
            Output::File(out) => out.write_all(bytes),
        };
        written.map_err(|e| Error::io("cannot write the file", e))
    }

    /// Everything has been written and is right: makes it visible. Returns the bytes of a file in
    /// memory.
    pub fn commit(self) -> Result<Vec<u8>> {
        match self {
            Output::Memory(bytes) => return Ok(bytes),
            Output::Stream(mut out) => {
                let flushed = out.flush();
                flushed.map_err(|e| Error::io("cannot write the file", e))?;
            }
            Output::File(out) => out.commit()?,
        }
        Ok(Vec::new())
    }
}

/// A file that is written under a temporary name in its folder and renamed when it is whole. If the process is
/// killed before that, what stood under the name before is untouched; if it merely fails, the temporary file is removed.
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
    /// Begins the file that will stand at `path`.
    ///
    /// # Errors
    /// `Io` if its folder cannot be written; `Input` if there is a folder at `path`.
    pub fn create(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        if path.is_dir() {
            return Err(Error::input(format!("{} is a folder", path.display())));
        }
        let folder = match path.parent() {
            Some(folder) if folder != Path::new("") => folder,
            _ => Path::new("."),
        };
        let mut builder = tempfile::Builder::new();
        builder.prefix(".").suffix(".tmp");
        #[cfg(unix)]
        {
            // As any new file: the user's mask decides, not the privacy of temporary files.
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

    /// Makes the file visible under its name, in place of whatever stood there.
    ///
    /// # Errors
    /// `Io`; what stood there is untouched then.
    pub fn commit(self) -> Result<()> {
        let failed = |e| Error::io(format!("cannot write {}", self.path.display()), e);
        let file = self.file.into_inner().map_err(|e| failed(e.into_error()))?;
        // On storage before it has the name: a crash must not leave the name without the bytes.
        file.as_file().sync_all().map_err(failed)?;
        file.persist(&self.path).map_err(|e| failed(e.error))?;
        Ok(())
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}
