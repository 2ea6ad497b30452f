//! A flat mip-mapped texture: OpenImageIO's texture system, called from C++ of our own, which is
//! compiled when the program runs.

use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use libloading::Library;

use crate::queries::Queries;

const SHIM: &str = include_str!("shim.cpp");

type Version = unsafe extern "C" fn() -> *const c_char;
type Write = unsafe extern "C" fn(*const c_char, *const f32, c_int) -> bool;
type Open = unsafe extern "C" fn(*const c_char, c_int, f32) -> *mut c_void;
type Sum = unsafe extern "C" fn(*mut c_void, usize, *const f32, *const f32, *mut f32) -> f32;

/// The compiler at work, in the background.
pub struct Compiling {
    folder: PathBuf,
    child: Result<Child, String>,
}

impl Compiling {
    /// Starts to compile the shim in `folder`.
    pub fn start(folder: &Path) -> Self {
        let source = folder.join("shim.cpp");
        let run = || {
            std::fs::write(&source, SHIM).map_err(|e| e.to_string())?;
            Command::new("g++")
                .args(["-O3", "-std=c++17", "-shared", "-fPIC", "-o"])
                .arg(folder.join("shim.so"))
                .arg(&source)
                .args(["-lOpenImageIO", "-lOpenImageIO_Util"])
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .spawn()
                .map_err(|e| format!("g++ does not run: {e}"))
        };
        Compiling {
            child: run(),
            folder: folder.to_owned(),
        }
    }

    /// A texture of `side` x `side` floats whose texel (i, j) holds `(i + 2 j + 1.5) / side`,
    /// footprints `width` texels wide; or why there is none.
    pub fn texture(self, side: u32, width: f32) -> Result<Texture, String> {
        let status = self.child?.wait().map_err(|e| e.to_string())?;
        if !status.success() {
            return Err("libopenimageio-dev is not installed: the shim does not compile".into());
        }
        Texture::open(&self.folder, side, width)
    }
}

/// A texture in the cache of a texture system.
pub struct Texture {
    /// Version of OpenImageIO.
    pub version: String,
    side: u32,
    texture: *mut c_void,
    sum: Sum,
    /// Keeps the code loaded.
    _library: Library,
}

impl Texture {
    fn open(folder: &Path, side: u32, width: f32) -> Result<Self, String> {
        let failed = |e: libloading::Error| e.to_string();
        let scale = 1.0 / side as f32;
        let texel = |i: u32| ((i % side) as f32 + 2.0 * (i / side) as f32 + 1.5) * scale;
        let base: Vec<f32> = (0..side * side).map(texel).collect();
        let path = folder.join("ramp.tif");
        let path = CString::new(path.to_string_lossy().as_bytes()).map_err(|e| e.to_string())?;
        // SAFETY: the library was compiled from `SHIM`, whose functions have these types; loading
        // it runs the initialisers of OpenImageIO, which ask nothing of us. `base` has side x side
        // floats, the path ends with a zero.
        unsafe {
            let library = Library::new(folder.join("shim.so")).map_err(failed)?;
            let version = *library.get::<Version>(b"shim_version\0").map_err(failed)?;
            let write = *library.get::<Write>(b"shim_write\0").map_err(failed)?;
            let open = *library.get::<Open>(b"shim_open\0").map_err(failed)?;
            let sum = *library.get::<Sum>(b"shim_sum\0").map_err(failed)?;
            if !write(path.as_ptr(), base.as_ptr(), side as c_int) {
                return Err("OpenImageIO cannot write the texture".into());
            }
            let texture = open(path.as_ptr(), side as c_int, width);
            if texture.is_null() {
                return Err("OpenImageIO cannot read the texture".into());
            }
            Ok(Texture {
                version: CStr::from_ptr(version()).to_string_lossy().into_owned(),
                side,
                texture,
                sum,
                _library: library,
            })
        }
    }

    /// Sum of the lookups at `queries`, in texels; their depths are not used.
    pub fn sum(&self, queries: &Queries) -> f32 {
        self.call(queries, std::ptr::null_mut())
    }

    /// The largest error of a lookup: a ramp has the same value at a point in all levels.
    pub fn max_error(&self, queries: &Queries) -> f64 {
        let mut answers = vec![f32::NAN; queries.len()];
        self.call(queries, answers.as_mut_ptr());
        let exact = |x: f32, y: f32| (f64::from(x) + 2.0 * f64::from(y)) / f64::from(self.side);
        let all = queries.iter().zip(&answers);
        all.map(|((x, y, _), a)| (f64::from(*a) - exact(x, y)).abs())
            .fold(0.0, f64::max)
    }

    fn call(&self, queries: &Queries, answers: *mut f32) -> f32 {
        let n = queries.len();
        assert!(queries.y.len() == n, "as many rows as columns");
        // SAFETY: the texture came from `shim_open` of the library that is still loaded; both
        // arrays have `n` floats, and `answers` is null or has as many (the two callers).
        unsafe {
            (self.sum)(
                self.texture,
                n,
                queries.x.as_ptr(),
                queries.y.as_ptr(),
                answers,
            )
        }
    }
}
