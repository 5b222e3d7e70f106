//! A self-contained HTML page: style, pictures and data in one file.

use base64::Engine;
use std::fmt::Write;

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;max-width:1080px;margin:2em auto;padding:0 1em;color:#222}\
h1{font-size:1.6em}h2{font-size:1.2em;margin-top:2em;border-bottom:1px solid #ddd}\
table{border-collapse:collapse;margin:1em 0}td,th{padding:.2em .8em;border-bottom:1px solid #eee;text-align:right}\
td:first-child,th:first-child{text-align:left}.strip{display:flex;flex-wrap:wrap;gap:4px}.strip figure{margin:0;width:24%}\
figcaption{font-size:12px;color:#666}svg{max-width:100%;height:auto}.warning{background:#fff4d6;padding:.5em 1em;border-left:4px solid #e0a000}";

/// A page under construction.
pub struct Page {
    body: String,
    title: String,
}

impl Page {
    /// An empty page with a title.
    pub fn new(title: &str) -> Self {
        Self { body: format!("<h1>{}</h1>\n", escape(title)), title: title.to_owned() }
    }

    /// A heading.
    pub fn heading(&mut self, text: &str) {
        let _ = writeln!(self.body, "<h2>{}</h2>", escape(text));
    }

    /// A paragraph.
    pub fn paragraph(&mut self, text: &str) {
        let _ = writeln!(self.body, "<p>{}</p>", escape(text));
    }

    /// A paragraph that stands out.
    pub fn warning(&mut self, text: &str) {
        let _ = writeln!(self.body, "<p class=\"warning\">{}</p>", escape(text));
    }

    /// A picture.
    pub fn svg(&mut self, svg: &str) {
        let _ = writeln!(self.body, "<div>{svg}</div>");
    }

    /// A table: the header, then the rows.
    pub fn table(&mut self, header: &[&str], rows: &[Vec<String>]) {
        let cells = |tag: &str, texts: &mut dyn Iterator<Item = &str>| {
            texts.map(|t| format!("<{tag}>{}</{tag}>", escape(t))).collect::<String>()
        };
        let head = cells("th", &mut header.iter().copied());
        let _ = write!(self.body, "<table><tr>{head}</tr>");
        for row in rows {
            let _ = write!(self.body, "<tr>{}</tr>", cells("td", &mut row.iter().map(String::as_str)));
        }
        self.body.push_str("</table>\n");
    }

    /// A strip of JPEG pictures; on each, points (u, v) in pixels of the picture are marked; a caption below.
    pub fn strip(&mut self, pictures: &[Picture]) {
        self.body.push_str("<div class=\"strip\">");
        for p in pictures {
            let data = base64::engine::general_purpose::STANDARD.encode(&p.jpeg);
            let marks: String = p
                .marks
                .iter()
                .map(|m| {
                    format!(
                        "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"7\" fill=\"none\" stroke=\"{}\" stroke-width=\"3\"/>",
                        m.at_px[0], m.at_px[1], m.colour
                    )
                })
                .collect();
            let _ = write!(
                self.body,
                "<figure><svg viewBox=\"0 0 {w} {h}\"><image href=\"data:image/jpeg;base64,{data}\" width=\"{w}\" height=\"{h}\"/>{marks}</svg><figcaption>{caption}</figcaption></figure>",
                w = p.width_px,
                h = p.height_px,
                caption = escape(&p.caption)
            );
        }
        self.body.push_str("</div>\n");
    }

    /// The whole page.
    pub fn finish(self) -> String {
        format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{}</title><style>{STYLE}</style></head>\n<body>\n{}</body></html>\n",
            escape(&self.title),
            self.body
        )
    }
}

/// A JPEG picture with marks.
pub struct Picture {
    /// The file's bytes.
    pub jpeg: Vec<u8>,
    /// Width in pixels.
    pub width_px: u32,
    /// Height in pixels.
    pub height_px: u32,
    /// Points to mark.
    pub marks: Vec<Mark>,
    /// Text below.
    pub caption: String,
}

/// A marked point.
pub struct Mark {
    /// (u, v) in pixels of the picture.
    pub at_px: [f64; 2],
    /// CSS colour.
    pub colour: &'static str,
}

/// `text` with the characters that HTML reads replaced.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_refers_to_nothing_outside_itself_and_escapes_text() {
        let mut page = Page::new("a < b");
        page.table(&["x"], &[vec!["\"1\" & 2".into()]]);
        let picture = Picture {
            jpeg: vec![1, 2, 3],
            width_px: 4,
            height_px: 5,
            marks: vec![Mark { at_px: [1.0, 2.0], colour: "red" }],
            caption: "c".into(),
        };
        page.strip(&[picture]);
        let html = page.finish();
        assert!(html.contains("a &lt; b") && html.contains("&quot;1&quot; &amp; 2") && html.contains("base64,AQID"));
        assert!(!html.contains("http"), "{html}");
    }
}
