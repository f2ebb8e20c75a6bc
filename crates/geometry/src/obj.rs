//! Reads Wavefront OBJ files: vertices, and the triangles of each material.

use crate::mesh::{lines, three_numbers};

/// Surfaces of a Wavefront OBJ file.
#[derive(Debug, Clone, Default, PartialEq)]
#[non_exhaustive]
pub struct Obj {
    /// Vertices, in the order of the file.
    pub vertices: Vec<[f64; 3]>,
    /// Triangles of each material, in the order of first use; polygons are split into triangle fans. The name is empty
    /// if no material was selected.
    pub groups: Vec<(String, Vec<[u32; 3]>)>,
    /// Names of the material files.
    pub libraries: Vec<String>,
}

impl Obj {
    /// Reads the content of an OBJ file. Lines may have any ending, and continue after a backslash.
    ///
    /// # Errors
    /// A vertex is not numeric, or a face has fewer than three vertices or an invalid index; the message names the
    /// line.
    pub fn read(content: &[u8]) -> Result<Self, String> {
        let text = String::from_utf8_lossy(content);
        let text = ["\\\r\n", "\\\n", "\\\r"].iter().fold(text.into_owned(), |text, end| text.replace(end, " "));
        let (mut out, mut material) = (Self::default(), String::new());
        let mut group = None;
        for (number, line) in lines(text.trim_start_matches('\u{feff}')).enumerate() {
            let mut words = line.split_whitespace();
            let Some(first) = words.next() else { continue };
            match first {
                "v" => out.vertices.push(three_numbers(words, number)?),
                "f" => {
                    let fail = |why: &str| format!("line {}: {why}", number + 1);
                    let count = out.vertices.len();
                    let corners: Vec<u32> = words
                        .map(|word| {
                            corner(word, count).ok_or_else(|| fail("a face refers to a vertex that does not exist"))
                        })
                        .collect::<Result<_, _>>()?;
                    let [start, rest @ ..] = corners.as_slice() else {
                        return Err(fail("a face has fewer than three corners"));
                    };
                    if rest.len() < 2 {
                        return Err(fail("a face has fewer than three corners"));
                    }
                    let at = *group.get_or_insert_with(|| {
                        out.groups.iter().position(|(name, _)| *name == material).unwrap_or_else(|| {
                            out.groups.push((material.clone(), Vec::new()));
                            out.groups.len() - 1
                        })
                    });
                    out.groups[at].1.extend(rest.windows(2).map(|pair| [*start, pair[0], pair[1]]));
                }
                "usemtl" => (material, group) = (words.collect::<Vec<_>>().join(" "), None),
                "mtllib" => {
                    let name = line.trim_start()["mtllib".len()..].trim().to_owned();
                    if !name.is_empty() && !out.libraries.contains(&name) {
                        out.libraries.push(name);
                    }
                }
                _ => {}
            }
        }
        let last = out.groups.iter().flat_map(|(_, faces)| faces).flatten().max();
        if last.is_some_and(|last| *last as usize >= out.vertices.len()) {
            return Err("a face refers to a vertex that does not exist".to_owned());
        }
        Ok(out)
    }
}

/// Parses the index of a face's vertex such as `12/3/4`, counted from 0; a negative index counts back from the `count`
/// vertices so far. A positive index may precede its vertex.
fn corner(word: &str, count: usize) -> Option<u32> {
    let index: i64 = word.split('/').next()?.parse().ok()?;
    let place = if index > 0 { index - 1 } else { i64::try_from(count).ok()? + index };
    u32::try_from(place).ok().filter(|_| index != 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_end_in_any_way_and_words_are_parted_by_any_space() {
        let text = "mtllib a b.mtl\nv 0 0 0\nv\t1 0 0 # edge\n  v 0 1 0 1\nv 9 9 9\nusemtl red\nf 1/1 2//2\t\\\n-2 1";
        let expected = Obj {
            vertices: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [9.0; 3]],
            groups: vec![("red".to_owned(), vec![[0, 1, 2], [0, 2, 0]])],
            libraries: vec!["a b.mtl".to_owned()],
        };
        for ends in ["\n", "\r\n", "\r"] {
            assert_eq!(Obj::read(text.replace('\n', ends).as_bytes()).unwrap(), expected, "{ends:?}");
        }
    }

    #[test]
    fn what_is_wrong_is_named_by_its_line() {
        for (text, message) in [
            ("v 1 2 x\n", "line 1"),
            ("v 1 2\n", "line 1"),
            ("v 0 0 0\nf 1 1\n", "line 2"),
            ("v 0 0 0\nf 0 1 1\n", "line 2"),
            ("v 0 0 0\nf -2 1 1\n", "line 2"),
            ("v 0 0 0\nf 1 x 1\n", "line 2"),
            ("v 0 0 0\nf 1 1 2\n", "does not exist"),
        ] {
            let error = Obj::read(text.as_bytes()).unwrap_err();
            assert!(error.contains(message), "{error}");
        }
    }
}
