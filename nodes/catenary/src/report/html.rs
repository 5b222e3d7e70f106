//! Self-contained HTML page: style, pictures and data in one file.

use super::palette;
use base64::Engine;
use std::fmt::Write;

/// Style of all pages. Pictures have columns of at least 380 px, so that their texts of 12 units have at least 11 px.
const STYLE: &str = "*{box-sizing:border-box}\
body{font:15px/1.5 system-ui,sans-serif;max-width:1080px;margin:0 auto;padding:16px 12px 48px;color:var(--ink);background:var(--paper);overflow-wrap:break-word}\
h1{font-size:1.5em;line-height:1.25}h2{font-size:1.2em;margin-top:2em;border-bottom:1px solid var(--rule)}\
.lead{background:var(--lead);border-left:4px solid var(--lead-edge);padding:.7em 1em;margin:1em 0;font-size:1.2em}.lead p{margin:.3em 0}\
.lead.bad,.warning{background:var(--doubt);border-left:4px solid var(--doubt-edge)}.warning{padding:.5em 1em;margin:1em 0}\
.warning p,.warning ul{margin:.2em 0}.warning ul{padding-left:1.2em}.note,small{color:var(--soft)}\
.plots{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,380px),1fr));gap:20px 24px;margin:1em 0;align-items:start}\
.plots figure{margin:0;max-width:560px;min-width:0}figcaption{font-weight:600;font-size:14px;margin-bottom:2px}\
.plots figure>svg{display:block;width:100%;height:auto}figure svg{font-family:system-ui,sans-serif}\
figure.fixed{margin:1em 0}.fixed .scroll{margin:0}.fixed .scroll svg{display:block}\
figure text{paint-order:stroke;stroke:var(--paper);stroke-width:3px;stroke-linejoin:round}\
.legend{display:flex;flex-wrap:wrap;gap:2px 14px;margin:2px 0 0;padding:0;list-style:none;font-size:13px}\
.legend li{display:flex;align-items:center;gap:5px}.swatch{width:20px;height:14px;flex:none}\
.replay g[data-t]{display:none}.replay g.still{display:inline}.replay.live g.still{opacity:.15}.replay.live g.now{display:inline;opacity:1}\
.controls{display:none}.live .controls{display:flex;gap:10px;align-items:center;margin:4px 0;font-size:13px}.controls input{flex:1;min-width:0}\
.controls button{font:inherit;min-width:4.5em}.controls output{min-width:4em;text-align:right;font-variant-numeric:tabular-nums}\
.scroll{overflow-x:auto;margin:1em 0}table{border-collapse:collapse}td,th{padding:.25em .8em;border-bottom:1px solid var(--rule);text-align:right;vertical-align:top;white-space:nowrap}\
td:first-child,th:first-child{text-align:left;padding-left:0;white-space:normal;min-width:90px}td:last-child{white-space:normal;overflow-wrap:anywhere;min-width:90px}th{font-weight:600;vertical-align:bottom;white-space:normal}\
.strip{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(48%,240px),1fr));gap:8px 4px}.strip figure{margin:0}.strip svg,img{max-width:100%;height:auto}\
.strip figcaption{font-size:12px;font-weight:400;color:var(--soft)}details{margin:1em 0}summary{cursor:pointer;font-weight:600}\
.film{width:100%;height:auto;border-radius:4px}.pair{display:grid;grid-template-columns:1fr 1fr;gap:8px;margin:.3em 0 1em}.pair b{font-size:1.5em;display:block}\
@media(max-width:600px){td,th{padding:.25em .35em;font-size:13px;white-space:normal}.lead{font-size:1.1em}}";

/// Slider and button of every replay. The page is complete without it.
const SCRIPT: &str = "document.querySelectorAll('.replay').forEach(r=>{const f=[...r.querySelectorAll('g[data-t]')],s=r.querySelector('input'),\
o=r.querySelector('output'),b=r.querySelector('button');if(!f.length)return;let t=0;\
const show=()=>{f.forEach((g,k)=>g.classList.toggle('now',k==s.value));o.textContent=f[s.value].dataset.t+' s'},\
stop=()=>{clearTimeout(t);t=0;b.textContent='play'},\
step=()=>{const k=+s.value;if(k+1>=f.length)return stop();t=setTimeout(()=>{s.value=k+1;show();step()},1e3*(f[k+1].dataset.t-f[k].dataset.t))};\
s.oninput=()=>{stop();show()};b.onclick=()=>{if(t)return stop();if(+s.value+1>=f.length)s.value=0;b.textContent='stop';show();step()};\
r.classList.add('live');show()})";

/// Page under construction.
pub struct Page {
    body: String,
    title: String,
    /// Pictures that follow one another. They are placed side by side if the page is wide enough.
    pictures: Vec<String>,
}

impl Page {
    /// Empty page with a title.
    pub fn new(title: &str) -> Self {
        Self { body: format!("<h1>{}</h1>\n", escape(title)), title: title.to_owned(), pictures: Vec::new() }
    }

    /// Answer of the page, in sentences; highlighted if it is bad news.
    pub fn answer(&mut self, sentences: &[String], is_bad: bool) {
        let class = if is_bad { "lead bad" } else { "lead" };
        let text: String = sentences.iter().map(|s| format!("<p>{}</p>", escape(s))).collect();
        let _ = writeln!(self.text(), "<div class=\"{class}\">{text}</div>");
    }

    /// Heading.
    pub fn heading(&mut self, text: &str) {
        let _ = writeln!(self.text(), "<h2>{}</h2>", escape(text));
    }

    /// Paragraph.
    pub fn paragraph(&mut self, text: &str) {
        let _ = writeln!(self.text(), "<p>{}</p>", escape(text));
    }

    /// Paragraph in grey.
    pub fn note(&mut self, text: &str) {
        let _ = writeln!(self.text(), "<p class=\"note\">{}</p>", escape(text));
    }

    /// One highlighted box with all reasons for doubt; nothing without any.
    pub fn warnings(&mut self, texts: &[String]) {
        let inside = match texts {
            [] => return,
            [text] => format!("<p>{}</p>", escape(text)),
            _ => {
                let items: String = texts.iter().map(|t| format!("<li>{}</li>", escape(t))).collect();
                format!("<p><b>{} reasons for doubt</b></p><ul>{items}</ul>", texts.len())
            }
        };
        let _ = writeln!(self.text(), "<div class=\"warning\">{inside}</div>");
    }

    /// Bullet list.
    pub fn list(&mut self, items: &[String]) {
        let items: String = items.iter().map(|i| format!("<li>{}</li>", escape(i))).collect();
        let _ = writeln!(self.text(), "<ul>{items}</ul>");
    }

    /// Picture as wide as the page, or markup of a page's own.
    pub fn wide(&mut self, html: &str) {
        let _ = writeln!(self.text(), "{html}");
    }

    /// SVG picture.
    pub fn svg(&mut self, svg: &str) {
        self.pictures.push(svg.to_owned());
    }

    /// Table: the header, then the rows. A table wider than the page scrolls by itself.
    pub fn table(&mut self, header: &[&str], rows: &[Vec<String>]) {
        let cells = |tag: &str, texts: &mut dyn Iterator<Item = &str>| {
            texts.map(|t| format!("<{tag}>{}</{tag}>", escape(t))).collect::<String>()
        };
        let head = cells("th", &mut header.iter().copied());
        let rows: String =
            rows.iter().map(|row| format!("<tr>{}</tr>", cells("td", &mut row.iter().map(String::as_str)))).collect();
        let _ = writeln!(self.text(), "<div class=\"scroll\"><table><tr>{head}</tr>{rows}</table></div>");
    }

    /// Section that is folded until the reader opens it.
    pub fn details<E>(&mut self, summary: &str, fill: impl FnOnce(&mut Self) -> Result<(), E>) -> Result<(), E> {
        let _ = write!(self.text(), "<details><summary>{}</summary>", escape(summary));
        fill(self)?;
        self.text().push_str("</details>\n");
        Ok(())
    }

    /// Body of the page, after the pending pictures are written.
    fn text(&mut self) -> &mut String {
        if !self.pictures.is_empty() {
            let _ = writeln!(self.body, "<div class=\"plots\">{}</div>", self.pictures.concat());
            self.pictures.clear();
        }
        &mut self.body
    }

    /// Strip of JPEG pictures with marked points (u, v) in pixels of the picture, and a caption below each.
    pub fn strip(&mut self, pictures: &[Picture]) {
        self.text().push_str("<div class=\"strip\">");
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

    /// HTML of the whole page.
    pub fn finish(mut self) -> String {
        self.text();
        let script =
            if self.body.contains("class=\"replay\"") { format!("<script>{SCRIPT}</script>\n") } else { String::new() };
        let style = format!("{}{STYLE}", palette::variables());
        format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\
             <link rel=\"icon\" href=\"data:,\"><meta name=\"color-scheme\" content=\"light dark\"><title>{}</title><style>{style}</style></head>\n<body>\n{}{script}</body></html>\n",
            escape(&self.title),
            self.body
        )
    }
}

/// JPEG picture with marks.
pub struct Picture {
    /// Bytes of the JPEG file.
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

/// Marked point.
pub struct Mark {
    /// Position (u, v) in pixels of the picture.
    pub at_px: [f64; 2],
    /// CSS colour.
    pub colour: &'static str,
}

/// Escapes the characters with a meaning in HTML.
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
        page.warnings(&["only <one>".into()]);
        page.warnings(&[]);
        page.svg("<figure>1</figure>");
        page.svg("<figure>2</figure>");
        let more = |page: &mut Page| {
            page.paragraph("p");
            Ok::<(), ()>(())
        };
        page.details("more", more).unwrap();
        let html = page.finish();
        assert!(html.contains("a &lt; b") && html.contains("&quot;1&quot; &amp; 2") && html.contains("base64,AQID"));
        // A page must be readable offline and must not report its readers to anybody.
        assert!(!html.contains("http"), "{html}");
        assert!(html.contains("<div class=\"plots\"><figure>1</figure><figure>2</figure></div>"), "{html}");
        assert_eq!(html.matches("class=\"warning\"").count(), 1, "{html}");
        assert!(html.contains("<p>only &lt;one&gt;</p>") && !html.contains("<script>"), "{html}");
        assert!(html.contains("name=\"viewport\"") && html.contains("<summary>more</summary><p>p</p>"), "{html}");
    }
}
