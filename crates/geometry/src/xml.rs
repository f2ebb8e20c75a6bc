//! XML text before a URDF reader sees it: readers differ in what they forgive, and some panic on what is not well formed
//! or names a namespace in an odd place. So one strict parser reads first, and hands on no more than a URDF is made of.

use roxmltree::{Document, Node};

use crate::UrdfError;

/// Elements inside elements: XML readers descend by recursion, and a stack ends.
const DEEPEST: usize = 100;

/// Well-formed text, its elements not deeper than a robot description ever needs.
pub(crate) fn parse<'t>(text: &'t str, file: &str) -> Result<Document<'t>, UrdfError> {
    check_depth(text, file)?;
    Document::parse(text).map_err(|e| UrdfError::new(file, "XML", format!("is not well formed: {e}")))
}

fn check_depth(text: &str, file: &str) -> Result<(), UrdfError> {
    let mut depth = 0_usize;
    let mut rest = text;
    while let Some(open) = rest.find('<') {
        rest = &rest[open + 1..];
        if let Some(comment) = rest.strip_prefix("!--") {
            rest = comment.find("-->").map_or("", |end| &comment[end..]);
            continue;
        }
        let tag = &rest[..rest.find('>').unwrap_or(rest.len())];
        if tag.starts_with('/') {
            depth = depth.saturating_sub(1);
        } else if !(tag.starts_with(['!', '?']) || tag.ends_with('/')) {
            depth += 1;
        }
        if depth > DEEPEST {
            return Err(UrdfError::new(file, "XML", format!("has elements more than {DEEPEST} deep")));
        }
    }
    Ok(())
}

/// Elements and attributes alone; what belongs to a namespace (extensions of other tools) is left out.
pub(crate) fn plain(document: &Document<'_>) -> String {
    let mut out = String::new();
    write_element(document.root_element(), &mut out);
    out
}

fn write_element(node: Node<'_, '_>, out: &mut String) {
    let name = node.tag_name().name();
    out.push('<');
    out.push_str(name);
    for attribute in node.attributes().filter(|a| a.namespace().is_none()) {
        out.push(' ');
        out.push_str(attribute.name());
        out.push_str("=\"");
        for c in attribute.value().chars() {
            match c {
                '&' => out.push_str("&amp;"),
                '<' => out.push_str("&lt;"),
                '>' => out.push_str("&gt;"),
                '"' => out.push_str("&quot;"),
                // Line ends and the like read the same this way in every reader.
                c if c.is_control() => out.push_str(&format!("&#{};", u32::from(c))),
                c => out.push(c),
            }
        }
        out.push('"');
    }
    out.push('>');
    for child in node.children().filter(|c| c.is_element() && c.tag_name().namespace() == node.tag_name().namespace()) {
        write_element(child, out);
    }
    out.push_str("</");
    out.push_str(name);
    out.push('>');
}
