//! Header attributes as raw bytes, with typed constructors and accessors.

/// A named header value, as the file stores it.
///
/// ```
/// use deepshadow_exr::Attribute;
/// let a = Attribute::float("aperture", 2.5);
/// assert_eq!((a.type_name.as_str(), a.as_float()), ("float", Some(2.5)));
/// assert_eq!(a.as_text(), None);
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attribute {
    /// Name.
    pub name: String,
    /// OpenEXR's type name, such as `m44f`.
    pub type_name: String,
    /// Value, little-endian.
    pub value: Vec<u8>,
}

impl Attribute {
    /// An attribute of any type.
    pub fn new(name: impl Into<String>, type_name: impl Into<String>, value: Vec<u8>) -> Self {
        Attribute {
            name: name.into(),
            type_name: type_name.into(),
            value,
        }
    }

    /// A `string`.
    pub fn text(name: impl Into<String>, value: &str) -> Self {
        Self::new(name, "string", value.as_bytes().to_vec())
    }

    /// An `int`.
    pub fn int(name: impl Into<String>, value: i32) -> Self {
        Self::new(name, "int", value.to_le_bytes().to_vec())
    }

    /// A `float`.
    pub fn float(name: impl Into<String>, value: f32) -> Self {
        Self::floats(name, "float", &[value])
    }

    /// A `v2f`.
    pub fn v2f(name: impl Into<String>, value: [f32; 2]) -> Self {
        Self::floats(name, "v2f", &value)
    }

    /// An `m44f` in OpenEXR's order: row by row, for row vectors (`p' = p M`).
    pub fn m44f(name: impl Into<String>, value: [f32; 16]) -> Self {
        Self::floats(name, "m44f", &value)
    }

    fn floats(name: impl Into<String>, type_name: &str, values: &[f32]) -> Self {
        let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        Self::new(name, type_name, bytes)
    }

    /// The value, if the attribute is a `string` in UTF-8.
    pub fn as_text(&self) -> Option<&str> {
        (self.type_name == "string")
            .then(|| std::str::from_utf8(&self.value).ok())
            .flatten()
    }

    /// The value, if the attribute is an `int`.
    pub fn as_int(&self) -> Option<i32> {
        let bytes = self.value.as_slice().try_into().ok()?;
        (self.type_name == "int").then(|| i32::from_le_bytes(bytes))
    }

    /// The value, if the attribute is a `float`.
    pub fn as_float(&self) -> Option<f32> {
        self.as_floats::<1>("float").map(|v| v[0])
    }

    /// The value, if the attribute is a `v2f`.
    pub fn as_v2f(&self) -> Option<[f32; 2]> {
        self.as_floats("v2f")
    }

    /// The value, if the attribute is an `m44f`, in the order of [`Attribute::m44f`].
    pub fn as_m44f(&self) -> Option<[f32; 16]> {
        self.as_floats("m44f")
    }

    fn as_floats<const N: usize>(&self, type_name: &str) -> Option<[f32; N]> {
        if self.type_name != type_name || self.value.len() != 4 * N {
            return None;
        }
        let mut values = [0.0; N];
        for (v, b) in values.iter_mut().zip(self.value.chunks_exact(4)) {
            *v = f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
        }
        Some(values)
    }
}
