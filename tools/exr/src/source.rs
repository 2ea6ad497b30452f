//! Positioned reads from a file or a stream, shared between threads.
//!
//! Files are read without a lock where the system has positioned reads; streams need one.

use crate::error::{Error, Result};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::sync::Mutex;

/// A stream that [`Source`] can read.
trait Stream: Read + Seek + Send {}
impl<T: Read + Seek + Send> Stream for T {}

enum Backend {
    #[cfg(any(unix, windows))]
    File(File),
    Stream(Mutex<Box<dyn Stream>>),
}

/// A file or stream of known length.
pub(crate) struct Source {
    backend: Backend,
    len: u64,
}

impl Source {
    pub(crate) fn file(file: File) -> Result<Self> {
        let meta = file
            .metadata()
            .map_err(|e| Error::io("cannot read the file's length", e))?;
        if !meta.is_file() {
            return Err(Error::input("not a regular file"));
        }
        #[cfg(any(unix, windows))]
        return Ok(Source {
            backend: Backend::File(file),
            len: meta.len(),
        });
        #[cfg(not(any(unix, windows)))]
        return Self::stream(file);
    }

    pub(crate) fn stream(mut stream: impl Read + Seek + Send + 'static) -> Result<Self> {
        let len = stream
            .seek(SeekFrom::End(0))
            .map_err(|e| Error::io("cannot seek to the end", e))?;
        Ok(Source {
            backend: Backend::Stream(Mutex::new(Box::new(stream))),
            len,
        })
    }

    pub(crate) fn len(&self) -> u64 {
        self.len
    }

    /// Fills `buffer` from `position`; the caller must check the range against [`Source::len`].
    pub(crate) fn read_at(&self, buffer: &mut [u8], position: u64) -> Result<()> {
        let read = match &self.backend {
            #[cfg(unix)]
            Backend::File(file) => {
                std::os::unix::fs::FileExt::read_exact_at(file, buffer, position)
            }
            #[cfg(windows)]
            Backend::File(file) => read_exact_at_windows(file, buffer, position),
            Backend::Stream(stream) => {
                // A poisoned lock is harmless: every read seeks first.
                let mut stream = stream.lock().unwrap_or_else(|e| e.into_inner());
                stream
                    .seek(SeekFrom::Start(position))
                    .and_then(|_| stream.read_exact(buffer))
            }
        };
        read.map_err(|e| Error::io("cannot read", e).at_byte(position))
    }

    /// Replaces the contents of `buffer` with `len` bytes from `position`.
    ///
    /// Checks the range before it allocates.
    pub(crate) fn read_vec(&self, buffer: &mut Vec<u8>, position: u64, len: u64) -> Result<()> {
        if position.checked_add(len).is_none_or(|end| end > self.len) {
            return Err(Error::corrupt(format!(
                "{len} bytes should be stored here, but the file ends at byte {}",
                self.len
            ))
            .at_byte(position));
        }
        let len =
            usize::try_from(len).map_err(|_| Error::limit("more bytes than the address space"))?;
        resize(buffer, len);
        self.read_at(buffer, position)
    }
}

/// Gives `buffer` `len` bytes of unspecified contents and no spare memory.
pub(crate) fn resize(buffer: &mut Vec<u8>, len: usize) {
    if buffer.capacity() < len {
        *buffer = Vec::new(); // Free the old memory first.
        *buffer = vec![0; len];
    } else {
        buffer.resize(len, 0);
    }
}

#[cfg(windows)]
fn read_exact_at_windows(file: &File, mut buffer: &mut [u8], mut at: u64) -> std::io::Result<()> {
    use std::os::windows::fs::FileExt;
    while !buffer.is_empty() {
        match file.seek_read(buffer, at) {
            Ok(0) => return Err(std::io::ErrorKind::UnexpectedEof.into()),
            Ok(n) => {
                buffer = &mut buffer[n..];
                at += n as u64;
            }
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(())
}
