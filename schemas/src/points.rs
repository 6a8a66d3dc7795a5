//! Coloured point clouds, stored as PLY.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{io::Write, path::Path};

use glam::DVec3;

use crate::{
    pose::Similarity,
    store::{self, StoreError},
};

/// Points with 8-bit sRGB colours; both arrays have one entry per point. Coordinates are `f64` in world
/// units, where scenes may lie far from the origin (UTM, ECEF), and `f32` where a scene is normalized.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PointCloud<T = f64> {
    /// Coordinates x, y, z.
    pub positions: Vec<[T; 3]>,
    /// Colours red, green, blue.
    pub colours: Vec<[u8; 3]>,
}

/// Names that programs give the properties of a colour: most, those after older readers of VTK, and those that shorten.
const COLOUR_NAMES: [[&str; 3]; 3] = [
    ["red", "green", "blue"],
    ["diffuse_red", "diffuse_green", "diffuse_blue"],
    ["r", "g", "b"],
];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PlyFormat {
    Ascii,
    BinaryLittleEndian,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn parse(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Reads a little-endian value; returns NaN where `bytes` holds fewer than [`Scalar::size`] bytes.
    fn decode(self, bytes: &[u8]) -> f64 {
        fn exactly<const BYTES: usize>(bytes: &[u8], value: fn([u8; BYTES]) -> f64) -> f64 {
            bytes.first_chunk().map_or(f64::NAN, |bytes| value(*bytes))
        }
        match self {
            Self::I8 => exactly(bytes, |bytes| f64::from(i8::from_le_bytes(bytes))),
            Self::U8 => exactly(bytes, |bytes| f64::from(u8::from_le_bytes(bytes))),
            Self::I16 => exactly(bytes, |bytes| f64::from(i16::from_le_bytes(bytes))),
            Self::U16 => exactly(bytes, |bytes| f64::from(u16::from_le_bytes(bytes))),
            Self::I32 => exactly(bytes, |bytes| f64::from(i32::from_le_bytes(bytes))),
            Self::U32 => exactly(bytes, |bytes| f64::from(u32::from_le_bytes(bytes))),
            Self::F32 => exactly(bytes, |bytes| f64::from(f32::from_le_bytes(bytes))),
            Self::F64 => exactly(bytes, f64::from_le_bytes),
        }
    }
}

#[derive(Debug)]
struct PlyHeader {
    format: PlyFormat,
    count: usize,
    properties: Vec<(String, Scalar)>,
    body: usize,
}

impl<T> PointCloud<T> {
    /// Makes a cloud of points of one colour.
    pub fn of_colour(positions: Vec<[T; 3]>, colour: [u8; 3]) -> Self {
        Self {
            colours: vec![colour; positions.len()],
            positions,
        }
    }

    /// Returns the number of points.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Returns true for a cloud without points.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }
}

impl PointCloud {
    /// Reads an ASCII or binary little-endian PLY whose first element is `vertex` with scalar properties x, y, z and
    /// optionally uchar red, green, blue (grey without), which may also be called `diffuse_red` and so on, or r, g, b.
    /// Points with coordinates that are not finite, also as 32-bit floats, are refused.
    ///
    /// # Errors
    /// When the file is missing, malformed or truncated.
    pub fn read_ply(path: &Path) -> Result<Self, StoreError> {
        let bytes = std::fs::read(path).map_err(|source| StoreError::read(path, source))?;
        Self::from_ply(&bytes).map_err(|reason| StoreError::malformed(path, reason))
    }

    /// Reads the bytes of a file as [`PointCloud::read_ply`] does.
    ///
    /// # Errors
    /// The fault of the bytes.
    pub fn from_ply(bytes: &[u8]) -> Result<Self, String> {
        let table = PlyTable::parse(bytes)?;
        let [Some(x), Some(y), Some(z)] = ["x", "y", "z"].map(|name| table.column(name)) else {
            return Err("PLY vertices have no x, y, z".to_owned());
        };
        let colour =
            COLOUR_NAMES
                .into_iter()
                .find_map(|names| match names.map(|name| table.column(name)) {
                    [Some(r), Some(g), Some(b)] => Some([r, g, b]),
                    _ => None,
                });
        // Colours in [0, 1] or 16 bits would silently turn black or white.
        if let Some(columns) = colour
            && columns
                .iter()
                .filter_map(|&column| table.header.properties.get(column))
                .any(|(_, scalar)| *scalar != Scalar::U8)
        {
            return Err("PLY colours are not uchar".to_owned());
        }
        let mut cloud = Self::default();
        table.for_each_row(|index, row| {
            // Rows have as many values as there are columns.
            let at = |column: usize| row.get(column).copied().unwrap_or(f64::NAN);
            let position = [x, y, z].map(at);
            if position.iter().any(|&value| !(value as f32).is_finite()) {
                return Err(format!("point {index} is not finite"));
            }
            cloud.positions.push(position);
            cloud.colours.push(colour.map_or([128; 3], |columns| {
                columns.map(|column| at(column).clamp(0.0, 255.0) as u8)
            }));
            Ok(())
        })?;
        Ok(cloud)
    }

    /// Writes a binary little-endian PLY, whole or not at all, with coordinates as [`Coordinates::of`]
    /// chooses them.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_ply(&self, path: &Path) -> Result<(), StoreError> {
        let coordinates = Coordinates::of(&self.positions);
        let kind = coordinates.ply_type();
        store::write_with(path, |writer| {
            write!(
                writer,
                "ply\nformat binary_little_endian 1.0\nelement vertex {}\n\
                 property {kind} x\nproperty {kind} y\nproperty {kind} z\n\
                 property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
                self.len()
            )?;
            for (position, colour) in self.positions.iter().zip(&self.colours) {
                coordinates.write(writer, position)?;
                writer.write_all(colour)?;
            }
            Ok(())
        })
    }
}

/// Type of the coordinates in a PLY.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Coordinates {
    /// `float`, which all programs read.
    Float,
    /// `double`, for large coordinates.
    Double,
}

impl Coordinates {
    /// Returns floats where they hold all coordinates exactly or their rounding is invisible in the scene
    /// ([`Similarity::fits_f32`] around the median point), doubles elsewhere.
    pub fn of(positions: &[[f64; 3]]) -> Self {
        let values = positions.as_flattened();
        if values.iter().all(|&value| f64::from(value as f32) == value) {
            return Self::Float;
        }
        let places: Vec<DVec3> = positions.iter().copied().map(DVec3::from_array).collect();
        Similarity::from_median(&places).map_or(Self::Float, |around| Self::around(&around))
    }

    /// Returns floats where their rounding is invisible around the offset of a normalization, doubles elsewhere.
    pub fn around(normalization: &Similarity) -> Self {
        if normalization.fits_f32() {
            Self::Float
        } else {
            Self::Double
        }
    }

    /// Returns its name in a PLY's header.
    pub fn ply_type(self) -> &'static str {
        match self {
            Self::Float => "float",
            Self::Double => "double",
        }
    }

    /// Writes little-endian coordinates.
    ///
    /// # Errors
    /// When they cannot be written.
    pub fn write(self, writer: &mut dyn Write, position: &[f64; 3]) -> std::io::Result<()> {
        for value in position {
            match self {
                Self::Float => writer.write_all(&(*value as f32).to_le_bytes())?,
                Self::Double => writer.write_all(&value.to_le_bytes())?,
            }
        }
        Ok(())
    }
}

/// Vertices of an ASCII or binary little-endian PLY whose first element is `vertex` with scalar properties. Errors
/// are the reason in one line, without the file.
#[derive(Debug)]
pub struct PlyTable<'a> {
    header: PlyHeader,
    body: &'a [u8],
}

impl<'a> PlyTable<'a> {
    /// Reads the header. There are no more vertices than the bytes can hold.
    ///
    /// # Errors
    /// When it is not such a PLY, or a binary body is truncated.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, String> {
        let header = parse_header(bytes)?;
        let table = Self {
            body: bytes.get(header.body..).unwrap_or_default(),
            header,
        };
        let least_bytes = match table.header.format {
            PlyFormat::Ascii => 1,
            PlyFormat::BinaryLittleEndian => table.stride().max(1),
        };
        let possible = table.body.len().checked_div(least_bytes).unwrap_or(0);
        if table.len() > possible {
            return Err(truncated(possible, table.len()));
        }
        Ok(table)
    }

    /// Returns the number of vertices.
    pub fn len(&self) -> usize {
        self.header.count
    }

    /// Returns true for a file without vertices.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the position of a property in a row.
    pub fn column(&self, name: &str) -> Option<usize> {
        let mut names = self.names();
        names.position(|other| other == name)
    }

    /// Returns the names of the properties in their order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.header.properties.iter().map(|(name, _)| name.as_str())
    }

    /// Returns the bytes of a vertex in a binary body.
    fn stride(&self) -> usize {
        let properties = self.header.properties.iter();
        properties.map(|(_, scalar)| scalar.size()).sum()
    }

    /// Calls `take` with the number and the values of every vertex in turn.
    ///
    /// # Errors
    /// When the body is truncated or not made of numbers, or `take` refuses a row.
    pub fn for_each_row(
        &self,
        mut take: impl FnMut(usize, &[f64]) -> Result<(), String>,
    ) -> Result<(), String> {
        let (count, properties) = (self.len(), &self.header.properties);
        match self.header.format {
            PlyFormat::Ascii => {
                let text = std::str::from_utf8(self.body).map_err(|_| "PLY body is not ASCII")?;
                let mut lines = text.lines().filter(|line| !line.trim().is_empty());
                for index in 0..count {
                    let line = lines.next().ok_or_else(|| truncated(index, count))?;
                    let row: Vec<f64> = line
                        .split_whitespace()
                        .map(str::parse)
                        .collect::<Result<_, _>>()
                        .map_err(|_| format!("point {index} is not a row of numbers"))?;
                    if row.len() < properties.len() {
                        return Err(format!("point {index} has too few values"));
                    }
                    take(index, &row)?;
                }
            }
            PlyFormat::BinaryLittleEndian => {
                let mut row = vec![0.0; properties.len()];
                let mut rest = self.body;
                for index in 0..count {
                    for (value, (_, scalar)) in row.iter_mut().zip(properties) {
                        let (field, after) = rest
                            .split_at_checked(scalar.size())
                            .ok_or_else(|| truncated(index, count))?;
                        *value = scalar.decode(field);
                        rest = after;
                    }
                    take(index, &row)?;
                }
            }
        }
        Ok(())
    }
}

fn truncated(found: usize, expected: usize) -> String {
    format!("PLY ends after {found} of {expected} points")
}

/// Returns the reason for refusing a PLY whose first element is not `vertex`.
fn first_element(name: &str) -> String {
    match name {
        "chunk" => {
            "is a compressed PLY as SuperSplat and PlayCanvas write it (the first PLY element is \
                    chunk); save it as an uncompressed one"
                .to_owned()
        }
        _ => format!("the first PLY element is {name}, not vertex"),
    }
}

fn parse_header(bytes: &[u8]) -> Result<PlyHeader, String> {
    // With the line break: comments may hold the word.
    const END: &[u8] = b"\nend_header";
    let end = bytes
        .windows(END.len())
        .position(|window| window == END)
        .ok_or("not a PLY file: no end_header")?;
    let (text, ending) = bytes.split_at_checked(end).unwrap_or_default();
    // The ending begins with the line break that closes the header's last line.
    let rest = ending.get(END.len()..).unwrap_or_default();
    let newline = rest.iter().position(|&byte| byte == b'\n');
    let body = newline.map_or(bytes.len(), |newline| {
        let before = end.saturating_add(END.len()).saturating_add(newline);
        before.saturating_add(1)
    });
    let text = std::str::from_utf8(text).map_err(|_| "PLY header is not ASCII")?;
    let mut format = None;
    let mut count = None;
    let mut properties = Vec::new();
    let mut in_vertex = false;
    for (number, line) in text.lines().enumerate() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.as_slice() {
            ["ply"] if number == 0 => {}
            _ if number == 0 => return Err("not a PLY file".to_owned()),
            ["format", "ascii", _] => format = Some(PlyFormat::Ascii),
            ["format", "binary_little_endian", _] => format = Some(PlyFormat::BinaryLittleEndian),
            ["format", other, ..] => return Err(format!("PLY format {other} is not supported")),
            ["element", "vertex", number] => {
                in_vertex = true;
                count = Some(
                    number
                        .parse()
                        .map_err(|_| "PLY vertex count is not a number")?,
                );
            }
            ["element", name, ..] if count.is_none() => return Err(first_element(name)),
            ["element", ..] => in_vertex = false,
            ["property", "list", ..] if in_vertex => {
                return Err("PLY vertices have a list property".to_owned());
            }
            ["property", kind, name] if in_vertex => properties.push((
                (*name).to_owned(),
                Scalar::parse(kind).ok_or_else(|| format!("PLY type {kind} is not known"))?,
            )),
            _ => {}
        }
    }
    Ok(PlyHeader {
        format: format.ok_or("PLY header has no format")?,
        count: count.ok_or("PLY header has no vertices")?,
        properties,
        body,
    })
}
