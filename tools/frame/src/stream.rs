//! Inputs and outputs that may be pipes: `-` is standard input or standard output.

use std::fs::File;
use std::io::{self, IsTerminal, Read, Seek};
use std::path::{Path, PathBuf};

use deepshadow::{DsmFile, Limits};

use crate::foreign::{FileKind, HEAD, identify_file};
use crate::{Failure, InFile, Result};

/// Whether `path` is `-` or the device of standard input.
pub fn is_standard_input(path: &Path) -> bool {
    ["-", "/dev/stdin"]
        .iter()
        .any(|name| path == Path::new(name))
}

/// Whether `path` is `-` or the device of standard output.
pub fn is_standard_output(path: &Path) -> bool {
    ["-", "/dev/stdout"]
        .iter()
        .any(|name| path == Path::new(name))
}

/// A file to read. Readers seek, so the bytes of a pipe go to an unnamed temporary file first.
#[derive(Debug)]
pub struct Input {
    file: File,
}

impl Input {
    /// Opens the file at `path`, or standard input for `-`.
    ///
    /// # Errors
    /// The error of the system; `IsADirectory` for a folder.
    pub fn open(path: &Path) -> io::Result<Self> {
        if path == Path::new("-") {
            return Self::spooled(io::stdin().lock());
        }
        let file = File::open(path)?;
        match file.metadata()?.file_type() {
            kind if kind.is_dir() => {
                let line = "a folder, not a file";
                Err(io::Error::new(io::ErrorKind::IsADirectory, line))
            }
            kind if kind.is_file() => Ok(Input { file }),
            _ => Self::spooled(file),
        }
    }

    fn spooled(mut from: impl Read) -> io::Result<Self> {
        let mut file = tempfile::tempfile()?;
        io::copy(&mut from, &mut file)?;
        Ok(Input { file })
    }

    /// The file; its position is the start.
    ///
    /// # Errors
    /// The error of the system.
    pub fn file(mut self) -> io::Result<File> {
        self.file.rewind()?;
        Ok(self.file)
    }

    /// Reads the kind of the file.
    ///
    /// # Errors
    /// The error of the system.
    pub fn kind(&mut self) -> io::Result<FileKind> {
        let mut head = Vec::new();
        self.file.rewind()?;
        self.file.by_ref().take(HEAD).read_to_end(&mut head)?;
        Ok(FileKind::of(&head))
    }

    /// Reads the whole file, up to `most` bytes.
    ///
    /// # Errors
    /// The error of the system; `FileTooLarge` for a longer file.
    pub fn bytes(self, most: u64) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.file()?.take(most + 1).read_to_end(&mut bytes)?;
        match bytes.len() as u64 > most {
            true => Err(io::ErrorKind::FileTooLarge.into()),
            false => Ok(bytes),
        }
    }

    /// Opens the file as a `.dsm` file, within `limits`.
    ///
    /// # Errors
    /// As [`DsmFile::open`]. The error for a file of another kind names that kind.
    pub fn dsm(mut self, limits: Limits) -> Result<DsmFile> {
        let length = self.file.metadata()?.len();
        DsmFile::from_file(self.file.try_clone()?, limits).map_err(|e| {
            if e.rule() != Some("HEADER-MAGIC") && length > 0 {
                return e.into();
            }
            Failure::Failed(match identify_file(&mut self.file) {
                Some(kind) => format!("not a .dsm file, but {kind}"),
                None => "not a .dsm file, and of an unknown kind".into(),
            })
        })
    }
}

/// Opens a `.dsm` file within `limits`, from standard input for `-`.
///
/// # Errors
/// `Failed`, naming the file and, if it is of another kind, that kind.
pub fn open_dsm(path: &Path, limits: Limits) -> Result<DsmFile> {
    Input::open(path).in_file(path)?.dsm(limits).in_file(path)
}

/// Where the bytes of an output go until it is complete: its own path, or for standard output a
/// file in a temporary folder.
#[derive(Debug)]
pub struct Destination {
    path: PathBuf,
    folder: Option<tempfile::TempDir>,
}

impl Destination {
    /// The destination of the output at `path`.
    ///
    /// # Errors
    /// `Usage` if standard output is a terminal; `Failed` without a folder for temporary files.
    pub fn of(path: &Path) -> Result<Self> {
        if !is_standard_output(path) {
            let path = path.to_owned();
            return Ok(Destination { path, folder: None });
        }
        if io::stdout().is_terminal() {
            let line = "-: standard output is a terminal; write to a file or a pipe";
            return Err(Failure::Usage(line.into()));
        }
        let folder = tempfile::tempdir()?;
        Ok(Destination {
            path: folder.path().join("output"),
            folder: Some(folder),
        })
    }

    /// The destination of a `.dsm` file; `runstats` is whether statistics go to standard output.
    ///
    /// # Errors
    /// As [`Destination::of`]; `Usage` for another extension.
    pub fn of_dsm(path: &Path, runstats: bool) -> Result<Self> {
        let is_dsm = |e: &std::ffi::OsStr| e.eq_ignore_ascii_case("dsm");
        let is_standard = is_standard_output(path);
        if !is_standard && !path.extension().is_some_and(is_dsm) {
            let line = format!("{}: the output must be a .dsm file", path.display());
            return Err(Failure::Usage(line));
        }
        if is_standard && runstats {
            let line = "--runstats: standard output takes the file; write to a file instead";
            return Err(Failure::Usage(line.into()));
        }
        Self::of(path)
    }

    /// The path to write to.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Copies the complete file to standard output, if that is where it goes. `made` is the result
    /// of writing the file.
    ///
    /// # Errors
    /// That of `made`, with `-` in place of a temporary name; `Failed` if standard output cannot be
    /// written. A closed pipe is no error.
    pub fn deliver(self, made: Result<()>) -> Result<()> {
        if self.folder.is_none() {
            return made;
        }
        if let Err(Failure::Failed(line)) = &made {
            let name = self.path.display().to_string();
            return Err(Failure::Failed(line.replace(&name, "-")));
        }
        made?;
        let mut file = File::open(&self.path)?;
        let mut out = io::stdout().lock();
        match io::copy(&mut file, &mut out).and_then(|_| io::Write::flush(&mut out)) {
            Err(e) if e.kind() != io::ErrorKind::BrokenPipe => Err(Failure::Failed(format!(
                "cannot write to standard output: {e}"
            ))),
            _ => Ok(()),
        }
    }
}
