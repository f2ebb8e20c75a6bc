//! XML documents: decoding, access to elements and attributes by name, numbers, and errors that name the element.

use roxmltree::{Document, Node};

use crate::UrdfError;

/// Maximum depth of nested elements. XML parsers recurse, and the stack is finite.
const DEEPEST: usize = 64;
const MAX_ELEMENTS: usize = 50_000;
/// Maximum number of undeclared prefixes that the reader declares.
const MAX_PREFIXES: usize = 16;

/// Returns the text of a document, encoded as its byte order mark or first line says; by default in UTF-8. Prefixes
/// without a declaration are declared.
pub(crate) fn decode(content: &[u8], file: &str) -> Result<String, UrdfError> {
    let fail = |message: String| UrdfError::new(file, "XML", format!("not XML: {message}"));
    let declared = declared_encoding(content);
    let encoding = match &declared {
        None => encoding_rs::UTF_8,
        Some(label) => encoding_rs::Encoding::for_label(label.as_bytes())
            .ok_or_else(|| fail(format!("the encoding {label:?} is not known; save the file as UTF-8")))?,
    };
    // A byte order mark takes precedence over a declaration.
    let (text, encoding, malformed) = encoding.decode(content);
    if malformed {
        let name = encoding.name();
        return Err(fail(format!(
            "the file is not {name}; declare its encoding in the first line, or save it as UTF-8"
        )));
    }
    Ok(with_prefixes(text.into_owned()))
}

/// Returns the encoding declared by `<?xml ... encoding="..."?>` at the beginning of a document.
fn declared_encoding(content: &[u8]) -> Option<String> {
    let head = String::from_utf8_lossy(&content[..content.len().min(200)]).into_owned();
    let head = head.trim_start_matches('\u{feff}').strip_prefix("<?xml")?;
    let (_, rest) = head[..head.find("?>")?].split_once("encoding")?;
    let rest = rest.trim_start().strip_prefix('=')?.trim_start();
    let quote = rest.chars().next().filter(|c| matches!(c, '"' | '\''))?;
    rest[1..].split_once(quote).map(|(label, _)| label.to_owned())
}

/// Parses well-formed text of bounded size and depth whose root element is `robot`.
pub(crate) fn parse<'t>(text: &'t str, file: &str) -> Result<Document<'t>, UrdfError> {
    let fail = |message: String| UrdfError::new(file, "XML", message);
    check_size(text).map_err(fail)?;
    let document = Document::parse(text).map_err(|e| match e {
        roxmltree::Error::DtdDetected => fail("has a DOCTYPE, which a URDF does not need; remove it".to_owned()),
        _ if text.trim().is_empty() => fail("not XML: no element found".to_owned()),
        _ => fail(format!("not XML: {e}")),
    })?;
    let root = document.root_element().tag_name().name();
    if root != "robot" {
        return Err(fail(format!("the first element is <{root}>; expected <robot>")));
    }
    Ok(document)
}

/// Returns an error for text with too many or too deeply nested elements.
pub(crate) fn check_size(text: &str) -> Result<(), String> {
    let (mut depth, mut count) = (0_usize, 0_usize);
    for tag in tags(text) {
        if tag.starts_with('/') {
            depth = depth.saturating_sub(1);
        } else if !tag.starts_with('!') {
            count += 1;
            depth += usize::from(!tag.ends_with('/'));
        }
        if depth > DEEPEST {
            return Err(format!("has elements nested more than {DEEPEST} levels deep"));
        }
        if count > MAX_ELEMENTS {
            return Err(format!("has more than {MAX_ELEMENTS} elements"));
        }
    }
    Ok(())
}

/// Returns the content of all tags between `<` and `>`, without comments, CDATA sections and instructions.
fn tags(text: &str) -> impl Iterator<Item = &str> {
    let mut rest = text;
    std::iter::from_fn(move || {
        loop {
            rest = &rest[rest.find('<')? + 1..];
            let whole = [("!--", "-->"), ("![CDATA[", "]]>"), ("?", "?>")];
            if let Some((inside, end)) = whole.iter().find_map(|(start, end)| Some((rest.strip_prefix(start)?, end))) {
                rest = inside.find(end).map_or("", |at| &inside[at + end.len()..]);
                continue;
            }
            let (tag, behind) = rest.split_at(tag_end(rest));
            rest = behind;
            return Some(tag);
        }
    })
}

/// Declares prefixes of elements and attributes, such as `drake:`, that a document uses without a declaration. Tools
/// that ignore XML namespaces write such documents. The elements and attributes are extensions and are ignored.
fn with_prefixes(text: String) -> String {
    let mut used: Vec<&str> = Vec::new();
    for prefix in tags(&text).filter(|tag| !tag.starts_with(['/', '!'])).flat_map(prefixes) {
        if !matches!(prefix, "xml" | "xmlns") && used.len() < MAX_PREFIXES && !used.contains(&prefix) {
            used.push(prefix);
        }
    }
    let is_declared = |prefix: &&str| {
        let name = format!("xmlns:{prefix}");
        text.match_indices(&name).any(|(at, _)| text[at + name.len()..].trim_start().starts_with('='))
    };
    let missing: Vec<&str> = used.into_iter().filter(|prefix| !is_declared(prefix)).collect();
    let Some(root) = tags(&text).find(|tag| !tag.starts_with('!')).filter(|_| !missing.is_empty()) else {
        return text;
    };
    let name = root.find(|c: char| c.is_whitespace() || c == '/').unwrap_or(root.len());
    let at = root.as_ptr() as usize - text.as_ptr() as usize + name;
    let declared: String = missing.iter().map(|prefix| format!(" xmlns:{prefix}=\"undeclared:{prefix}\"")).collect();
    format!("{}{declared}{}", &text[..at], &text[at..])
}

/// Returns the prefixes of the names in a tag; a `:` inside quotes does not count.
fn prefixes(tag: &str) -> Vec<&str> {
    let (mut quote, mut start, mut out) = (None, 0, Vec::new());
    for (at, c) in tag.char_indices() {
        match (quote, c) {
            (Some(open), _) if open == c => quote = None,
            (Some(_), _) => (),
            (None, '"' | '\'') => quote = Some(c),
            (None, ':') => out.push(&tag[start..at]),
            (None, c) if c.is_whitespace() => start = at + c.len_utf8(),
            _ => (),
        }
    }
    out
}

/// Returns the length of a tag up to its closing `>`; a `>` inside quotes does not count.
fn tag_end(tag: &str) -> usize {
    let mut quote = None;
    let ends = |(_, c): &(usize, char)| {
        match (quote, c) {
            (None, '>') => return true,
            (None, '"' | '\'') => quote = Some(*c),
            (Some(open), c) if open == *c => quote = None,
            _ => (),
        }
        false
    };
    tag.char_indices().find(ends).map_or(tag.len(), |(at, _)| at)
}

/// An element, with its name for error messages.
#[derive(Clone)]
pub(crate) struct Element<'d> {
    node: Node<'d, 'd>,
    pub field: String,
    file: &'d str,
}

impl<'d> Element<'d> {
    pub fn root(document: &'d Document<'d>, file: &'d str) -> Self {
        Self { node: document.root_element(), field: "robot".to_owned(), file }
    }

    /// Returns the element with another name for error messages.
    pub fn called(&self, field: String) -> Self {
        Self { field, ..self.clone() }
    }

    pub fn fail(&self, message: impl Into<String>) -> UrdfError {
        UrdfError::new(self.file, &self.field, message)
    }

    /// Creates an error about an attribute of this element.
    pub fn wrong(&self, attribute: &str, message: impl Into<String>) -> UrdfError {
        UrdfError::new(self.file, format!("{}.{attribute}", self.field), message)
    }

    pub fn name(&self) -> &'d str {
        self.node.tag_name().name()
    }

    /// Returns the child elements. Children in another namespace are extensions of other tools and are ignored.
    ///
    /// # Errors
    /// A child is a xacro macro.
    pub fn children(&self) -> Result<Vec<Element<'d>>, UrdfError> {
        let mut out = Vec::new();
        for node in self.node.children().filter(Node::is_element) {
            let tag = node.tag_name();
            // Xacro tools recognize the prefix `xacro`, whatever its namespace.
            if tag.namespace().is_some_and(|uri| node.lookup_prefix(uri) == Some("xacro")) {
                let message = format!("<xacro:{}> is not expanded; {}", tag.name(), expand(self.file));
                return Err(self.fail(message));
            }
            if tag.namespace() == self.node.tag_name().namespace() {
                out.push(Self { node, field: format!("{}: {}", self.field, tag.name()), file: self.file });
            }
        }
        Ok(out)
    }

    /// Refuses elements and attributes that look misspelt; a name unlike any known name counts as an extension.
    pub fn check_spelling(&self, elements: &[&str], attributes: &[&str]) -> Result<(), UrdfError> {
        for child in self.children()? {
            if let Some(meant) = meant(child.name(), elements) {
                return Err(self.fail(format!("<{}> is not known; write <{meant}>", child.name())));
            }
        }
        for attribute in self.node.attributes().filter(|a| a.namespace().is_none()) {
            if let Some(meant) = meant(attribute.name(), attributes) {
                return Err(self.fail(format!("{} is not known; write {meant}", attribute.name())));
            }
        }
        Ok(())
    }

    /// Names of the element's attributes.
    pub fn attributes(&self) -> impl Iterator<Item = &'d str> {
        self.node.attributes().filter(|a| a.namespace().is_none()).map(|a| a.name())
    }

    /// Returns the child element of this name, if there is one; several are an error.
    pub fn child(&self, name: &str) -> Result<Option<Element<'d>>, UrdfError> {
        let mut named = self.children()?.into_iter().filter(|c| c.name() == name);
        let first = named.next();
        if named.next().is_some() {
            return Err(self.fail(format!("has two <{name}>; keep one")));
        }
        Ok(first)
    }

    /// Returns the text of an attribute; unexpanded xacro is an error.
    pub fn text(&self, name: &str) -> Result<Option<&'d str>, UrdfError> {
        let Some(value) = self.node.attribute(name) else { return Ok(None) };
        if value.contains("${") || value.contains("$(") {
            return Err(self.wrong(name, format!("{value:?} is not expanded; {}", expand(self.file))));
        }
        Ok(Some(value))
    }

    pub fn required(&self, name: &str) -> Result<&'d str, UrdfError> {
        match self.text(name)? {
            Some(value) if !value.trim().is_empty() => Ok(value),
            _ => Err(self.wrong(name, format!("is missing; write {name}=\"...\""))),
        }
    }

    /// Returns the numbers of an attribute, which may be infinite.
    pub fn open<const N: usize>(&self, name: &str) -> Result<Option<[f64; N]>, UrdfError> {
        let Some(text) = self.text(name)? else { return Ok(None) };
        let numbers: Vec<f64> = text.split_whitespace().map_while(|word| word.parse().ok()).collect();
        let whole = numbers.len() == text.split_whitespace().count() && numbers.iter().all(|v| !v.is_nan());
        match <[f64; N]>::try_from(numbers) {
            Ok(numbers) if whole => Ok(Some(numbers)),
            _ => Err(self.wrong(name, format!("not {}: {text:?}", wanted(N)))),
        }
    }

    /// Returns the `N` numbers in an attribute, or `None` without the attribute. Numbers must be finite.
    pub fn numbers<const N: usize>(&self, name: &str) -> Result<Option<[f64; N]>, UrdfError> {
        let found = self.open(name)?;
        match found.iter().flatten().find(|v| !v.is_finite()) {
            Some(v) => Err(self.wrong(name, format!("not {}: {v}", wanted(N)))),
            None => Ok(found),
        }
    }

    pub fn number(&self, name: &str) -> Result<Option<f64>, UrdfError> {
        Ok(self.numbers::<1>(name)?.map(|[value]| value))
    }

    /// Returns the positive, finite numbers of a required attribute.
    pub fn positive<const N: usize>(&self, name: &str) -> Result<[f64; N], UrdfError> {
        let _ = self.required(name)?;
        let found = self.numbers(name)?.ok_or_else(|| self.wrong(name, "is missing"))?;
        match found.iter().find(|v| **v <= 0.0) {
            Some(v) => Err(self.wrong(name, format!("must be positive, not {v}"))),
            None => Ok(found),
        }
    }
}

fn wanted(count: usize) -> String {
    match count {
        1 => "one finite number".to_owned(),
        3 => "three finite numbers".to_owned(),
        4 => "four finite numbers".to_owned(),
        n => format!("{n} finite numbers"),
    }
}

fn expand(file: &str) -> String {
    format!("run `xacro {file} > robot.urdf` and read that")
}

/// Returns the known name that an unknown name probably means, if it looks like a misspelling.
fn meant<'n>(name: &str, known: &[&'n str]) -> Option<&'n str> {
    if known.contains(&name) {
        return None;
    }
    let lower = name.to_ascii_lowercase();
    let typos = |k: &str| strsim::osa_distance(&lower, k);
    known.iter().copied().find(|k| typos(k) <= if k.len() > 5 { 2 } else { usize::from(k.len() > 3) })
}

#[cfg(test)]
mod tests {
    use super::{check_size, decode, meant, parse};

    #[test]
    fn depth_is_counted_whatever_stands_in_quotes_and_sections() {
        for opening in ["<a b='/>'>", "<a b=\"</a>\">", "<a><![CDATA[</a>]]>", "<a><?p </a>?>", "<a><!--</a>-->"] {
            assert!(check_size(&opening.repeat(1000)).unwrap_err().contains("levels deep"), "{opening}");
        }
        for flat in ["<a b='>'/>", "<a></a>", "<a>'</a>"] {
            assert!(check_size(&format!("<robot>{}</robot>", flat.repeat(1000))).is_ok(), "{flat}");
        }
    }

    #[test]
    fn prefixes_without_a_declaration_are_declared_and_their_elements_ignored() {
        let text =
            decode(b"<?xml version='1.0'?><!-- <robot> --><robot name='a'><d:x e='>'/><l f:y='g:h'/></robot>", "a")
                .unwrap();
        assert!(text.contains("<robot xmlns:d=\"undeclared:d\" xmlns:f=\"undeclared:f\" name='a'>"), "{text}");
        assert!(parse(&text, "a").is_ok());
        for declared in ["<robot xmlns:d='e'><d:x/></robot>", "<robot xmlns:d = 'e'><d:x/></robot>"] {
            assert_eq!(decode(declared.as_bytes(), "a").unwrap(), declared);
        }
        let other = decode(b"<robot xmlns:d2='e'><d:x/></robot>", "a").unwrap();
        assert!(parse(&other, "a").is_ok(), "{other}");
        let xacro = decode(b"<robot><xacro:include filename='b'/></robot>", "a").unwrap();
        let message = crate::Description::parse(&xacro, "a").unwrap_err().message;
        assert!(message.contains("<xacro:include>"), "{message}");
    }

    #[test]
    fn documents_are_read_in_the_encoding_that_they_declare() {
        let latin = b"<?xml version='1.0' encoding='ISO-8859-1'?><robot name='tr\xe4ger'/>";
        assert!(decode(latin, "a").unwrap().contains("träger"));
        let refused = decode(b"<robot name='tr\xe4ger'/>", "a").unwrap_err();
        assert!(refused.message.contains("not UTF-8"), "{refused}");
        let mut wide = vec![0xff, 0xfe];
        wide.extend("<?xml version=\"1.0\" encoding=\"UTF-16\"?><robot/>".encode_utf16().flat_map(u16::to_le_bytes));
        assert!(decode(&wide, "a").unwrap().ends_with("<robot/>"));
        assert!(decode(b"\xef\xbb\xbf<robot/>", "a").unwrap().starts_with('<'));
        assert!(decode(b"<?xml version='1.0' encoding='klingon'?><robot/>", "a").is_err());
    }

    #[test]
    fn misspelt_names_are_told_from_extensions() {
        let known = ["limit", "origin", "collision", "safety_controller"];
        assert_eq!(meant("limits", &known), Some("limit"));
        assert_eq!(meant("colision", &known), Some("collision"));
        assert_eq!(meant("Origin", &known), Some("origin"));
        for other in ["limit", "hardwareInterface", "sensor", "contact", "gazebo"] {
            assert_eq!(meant(other, &known), None, "{other}");
        }
    }
}
