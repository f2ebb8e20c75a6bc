//! Reads vertices and triangles of PLY files.

use crate::mesh::lines;

/// Vertices, and triangles; each face is split into a triangle fan.
type Surface = (Vec<[f64; 3]>, Vec<[u32; 3]>);

/// Type of a number in a PLY file.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Int { bytes: usize, signed: bool },
    Float { bytes: usize },
}

impl Kind {
    fn of(name: &str) -> Result<Self, String> {
        let int = |bytes, signed| Ok(Self::Int { bytes, signed });
        match name {
            "char" | "int8" => int(1, true),
            "uchar" | "uint8" => int(1, false),
            "short" | "int16" => int(2, true),
            "ushort" | "uint16" => int(2, false),
            "int" | "int32" => int(4, true),
            "uint" | "uint32" => int(4, false),
            "float" | "float32" => Ok(Self::Float { bytes: 4 }),
            "double" | "float64" => Ok(Self::Float { bytes: 8 }),
            other => Err(format!("PLY property type {other:?} is not known")),
        }
    }
}

struct Property {
    name: String,
    kind: Kind,
    /// Number type of a list's length.
    count: Option<Kind>,
}

struct Section {
    name: String,
    rows: usize,
    properties: Vec<Property>,
}

/// Content of a PLY file after its header, read value by value.
enum Body<'b> {
    Text(std::str::SplitWhitespace<'b>),
    Binary { bytes: &'b [u8], big: bool },
}

impl Body<'_> {
    fn next(&mut self, kind: Kind) -> Result<f64, String> {
        const SHORT: &str = "PLY is cut short";
        match self {
            Self::Text(words) => {
                let word = words.next().ok_or(SHORT)?;
                word.parse().map_err(|_| format!("PLY has {word:?} in place of a number"))
            }
            Self::Binary { bytes, big } => {
                let (Kind::Int { bytes: size, .. } | Kind::Float { bytes: size }) = kind;
                let (value, rest) = bytes.split_at_checked(size).ok_or(SHORT)?;
                *bytes = rest;
                let mut word = [0u8; 8];
                word[..size].copy_from_slice(value);
                if *big {
                    word[..size].reverse();
                }
                let shift = 64 - 8 * size as u32;
                Ok(match kind {
                    Kind::Float { bytes: 4 } => f64::from(f32::from_le_bytes([word[0], word[1], word[2], word[3]])),
                    Kind::Float { .. } => f64::from_le_bytes(word),
                    Kind::Int { signed: true, .. } => ((i64::from_le_bytes(word) << shift) >> shift) as f64,
                    Kind::Int { .. } => u64::from_le_bytes(word) as f64,
                })
            }
        }
    }
}

pub(crate) fn read(content: &[u8]) -> Result<Surface, String> {
    let (format, sections, rest) = header(content)?;
    let mut body = match format.as_str() {
        "ascii" => Body::Text(std::str::from_utf8(rest).map_err(|_| "PLY body is not text")?.split_whitespace()),
        "binary_little_endian" => Body::Binary { bytes: rest, big: false },
        "binary_big_endian" => Body::Binary { bytes: rest, big: true },
        other => return Err(format!("PLY format {other:?} is not known")),
    };
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for section in &sections {
        if section.name == "vertex" {
            for name in ["x", "y", "z"] {
                if !section.properties.iter().any(|p| p.name == name && p.count.is_none()) {
                    return Err(format!("PLY vertices have no {name}"));
                }
            }
        }
        if section.properties.is_empty() {
            continue;
        }
        for _ in 0..section.rows {
            let (mut vertex, mut corners) = ([0.0; 3], Vec::new());
            for property in &section.properties {
                let is_face =
                    section.name == "face" && ["vertex_indices", "vertex_index"].contains(&property.name.as_str());
                let Some(count) = property.count else {
                    let value = body.next(property.kind)?;
                    if let Some(axis) = ["x", "y", "z"].iter().position(|axis| property.name == *axis) {
                        vertex[axis] = value;
                    }
                    continue;
                };
                let count = body.next(count)?;
                for _ in 0..count as usize {
                    let value = body.next(property.kind)?;
                    if is_face {
                        corners.push(value);
                    }
                }
            }
            match section.name.as_str() {
                "vertex" => vertices.push(vertex),
                "face" => faces.push(corners),
                _ => {}
            }
        }
    }
    let mut triangles = Vec::new();
    for corners in faces {
        if let Some(c) = corners.iter().find(|c| c.fract() != 0.0 || !(0.0..vertices.len() as f64).contains(*c)) {
            return Err(format!("a face of PLY names vertex {c} of {}", vertices.len()));
        }
        let corners: Vec<u32> = corners.iter().map(|c| *c as u32).collect();
        if let [start, rest @ ..] = corners.as_slice() {
            triangles.extend(rest.windows(2).map(|pair| [*start, pair[0], pair[1]]));
        }
    }
    Ok((vertices, triangles))
}

fn header(content: &[u8]) -> Result<(String, Vec<Section>, &[u8]), String> {
    const END: &[u8] = b"end_header";
    let end = content.windows(END.len()).position(|w| w == END).ok_or("PLY header has no end_header")?;
    let text = std::str::from_utf8(&content[..end]).map_err(|_| "PLY header is not text")?;
    let rest = &content[end + END.len()..];
    let rest = rest.strip_prefix(b"\r\n").or(rest.strip_prefix(b"\n")).or(rest.strip_prefix(b"\r"));
    let rest = rest.ok_or("PLY has no body")?;
    let (mut format, mut sections) = (String::new(), Vec::<Section>::new());
    for line in lines(text) {
        let words: Vec<&str> = line.split_whitespace().collect();
        let property = match words.as_slice() {
            ["format", kind, ..] => {
                format = (*kind).to_owned();
                continue;
            }
            ["element", name, rows] => {
                let rows = rows.parse().map_err(|_| format!("PLY has {rows:?} of {name}"))?;
                if sections.iter().any(|s| s.name == *name) {
                    return Err(format!("PLY names its {name} twice"));
                }
                sections.push(Section { name: (*name).to_owned(), rows, properties: Vec::new() });
                continue;
            }
            ["property", "list", count, kind, name] => {
                Property { name: (*name).to_owned(), kind: Kind::of(kind)?, count: Some(Kind::of(count)?) }
            }
            ["property", kind, name] => Property { name: (*name).to_owned(), kind: Kind::of(kind)?, count: None },
            _ => continue,
        };
        sections.last_mut().ok_or("PLY has a property of no element")?.properties.push(property);
    }
    Ok((format, sections, rest))
}

#[cfg(test)]
mod tests {
    use super::read;

    #[test]
    fn text_and_binary_of_both_orders_are_read_alike() {
        let header = |format: &str| {
            format!(
                "ply\nformat {format} 1.0\nelement vertex 3\nproperty uchar r\nproperty float x\n\
                     property float y\nproperty double z\nelement face 1\nproperty list uchar int vertex_indices\n\
                     end_header\n"
            )
        };
        let rows: [[f64; 3]; 3] = [[0.0, 0.0, 0.0], [1.5, 2.5, 3.5], [0.0, 1.0, 0.0]];
        let expected = (rows.to_vec(), vec![[0, 2, 1]]);
        let (mut little, mut big) =
            (header("binary_little_endian").into_bytes(), header("binary_big_endian").into_bytes());
        let mut text = header("ascii");
        for [x, y, z] in rows {
            text += &format!("7 {x} {y} {z}\n");
            little.push(7);
            big.push(7);
            for v in [x, y] {
                little.extend((v as f32).to_le_bytes());
                big.extend((v as f32).to_be_bytes());
            }
            little.extend(z.to_le_bytes());
            big.extend(z.to_be_bytes());
        }
        text += "3 0 2 1\n";
        little.push(3);
        big.push(3);
        for v in [0i32, 2, 1] {
            little.extend(v.to_le_bytes());
            big.extend(v.to_be_bytes());
        }
        assert_eq!(read(text.as_bytes()).unwrap(), expected);
        assert_eq!(read(text.replace('\n', "\r").as_bytes()).unwrap(), expected);
        assert_eq!(read(&little).unwrap(), expected);
        assert_eq!(read(&big).unwrap(), expected);
        assert!(read(&little[..little.len() - 1]).unwrap_err().contains("cut short"));
        assert!(read(text.replace("0 2 1", "0 2 3").as_bytes()).unwrap_err().contains("names vertex 3"));
        assert!(read(b"ply\nend_header").is_err());
    }
}
