//! Rust source as tokens, without comments, the text of literals, and test code. Rough, but it
//! knows nested comments, raw strings, and characters from lifetimes.

/// A word or a sign, with its line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Token {
    pub text: String,
    pub line: usize,
}

/// A path from the root of the crate or of `std`, use trees multiplied out.
#[derive(Debug)]
pub struct PathUse {
    pub segments: Vec<String>,
    pub line: usize,
    /// Whether it was written from `crate` (else by `super` or the library's name).
    from_crate: bool,
}

/// A source file.
#[derive(Debug)]
pub struct File {
    /// Path from the package's root, with `/`.
    pub name: String,
    /// Its tokens without test code.
    pub tokens: Vec<Token>,
    /// Modules declared under `#[cfg(test)]`, as the path of their file without `.rs`.
    pub test_files: Vec<String>,
}

/// Tokens of a text: words, numbers, `::`, and single signs; literals become one `""` or `0`.
pub fn tokens(text: &str) -> Vec<Token> {
    let letters: Vec<char> = text.chars().collect();
    let mut found = Vec::new();
    let mut line = 1;
    let mut at = 0;
    while at < letters.len() {
        let rest = &letters[at..];
        let end = at + token_length(rest);
        let is_comment = rest.starts_with(&['/', '/']) || rest.starts_with(&['/', '*']);
        if !rest[0].is_whitespace() && !is_comment {
            let text: String = letters[at..end].iter().collect();
            let text = if text.contains(['"', '\'']) && !is_lifetime(rest) { "\"\"".into() } else { text };
            found.push(Token { text, line });
        }
        line += letters[at..end].iter().filter(|&&c| c == '\n').count();
        at = end;
    }
    found
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

fn is_lifetime(rest: &[char]) -> bool {
    rest[0] == '\'' && rest.get(1).is_some_and(|&c| is_word(c)) && rest.get(2) != Some(&'\'')
}

fn token_length(rest: &[char]) -> usize {
    let until = |from: usize, stop: &dyn Fn(&[char]) -> bool| {
        (from..rest.len()).find(|&i| stop(&rest[i..])).unwrap_or(rest.len())
    };
    match rest[0] {
        '/' if rest.starts_with(&['/', '/']) => until(0, &|r| r[0] == '\n'),
        '/' if rest.starts_with(&['/', '*']) => block_comment_length(rest),
        '"' => quoted_length(rest, '"'),
        '\'' if is_lifetime(rest) => until(1, &|r| !is_word(r[0])),
        '\'' => quoted_length(rest, '\''),
        c if is_word(c) => {
            let end = until(0, &|r| !is_word(r[0]));
            let prefix: String = rest[..end].iter().collect();
            match (prefix.as_str(), rest.get(end)) {
                ("b" | "c", Some('"')) => end + quoted_length(&rest[end..], '"'),
                ("b", Some('\'')) => end + quoted_length(&rest[end..], '\''),
                ("r" | "br" | "cr", Some('"' | '#')) => end + raw_length(&rest[end..]),
                _ => end,
            }
        }
        ':' if rest.starts_with(&[':', ':']) => 2,
        _ => 1,
    }
}

fn block_comment_length(rest: &[char]) -> usize {
    let (mut depth, mut at) = (0, 0);
    while at < rest.len() {
        if rest[at..].starts_with(&['/', '*']) {
            depth += 1;
            at += 2;
        } else if rest[at..].starts_with(&['*', '/']) {
            depth -= 1;
            at += 2;
            if depth == 0 {
                return at;
            }
        } else {
            at += 1;
        }
    }
    rest.len()
}

fn quoted_length(rest: &[char], quote: char) -> usize {
    let mut at = 1;
    while at < rest.len() {
        match rest[at] {
            '\\' => at += 2,
            c if c == quote => return at + 1,
            _ => at += 1,
        }
    }
    rest.len()
}

/// Length of `#"…"#` after its `r`; 0 where it is a raw identifier.
fn raw_length(rest: &[char]) -> usize {
    let hashes = rest.iter().take_while(|&&c| c == '#').count();
    if rest.get(hashes) != Some(&'"') {
        return 0;
    }
    let closes = |i: usize| rest[i] == '"' && rest[i + 1..].iter().take_while(|&&c| c == '#').count() >= hashes;
    (hashes + 1..rest.len()).find(|&i| closes(i)).map_or(rest.len(), |i| i + 1 + hashes)
}

impl File {
    /// Parses a file; `name` is its path from the package's root.
    pub fn parse(name: &str, text: &str) -> Self {
        let all = tokens(text);
        let mut kept = Vec::new();
        let mut test_files = Vec::new();
        let mut at = 0;
        while at < all.len() {
            let is = |offset: usize, text: &str| all.get(at + offset).is_some_and(|t| t.text == text);
            let cfg_test = ["#", "[", "cfg", "(", "test", ")", "]"].iter().enumerate().all(|(i, t)| is(i, t));
            let test = ["#", "[", "test", "]"].iter().enumerate().all(|(i, t)| is(i, t));
            if cfg_test || test {
                let end = item_end(&all, at);
                let item = &all[at..end];
                let declared = item.windows(3).find(|w| w[0].text == "mod" && w[2].text == ";");
                test_files.extend(declared.map(|w| format!("{}/{}", folder_of_children(name), w[1].text)));
                at = end;
            } else {
                kept.push(all[at].clone());
                at += 1;
            }
        }
        Self { name: name.into(), tokens: kept, test_files }
    }

    /// The module at the root that the file belongs to; "lib" and "main" for those two.
    pub fn module(&self) -> &str {
        let inside = self.name.strip_prefix("src/").unwrap_or(&self.name);
        inside.split(['/', '.']).next().unwrap_or(inside)
    }

    /// Whether the file is `stem`.rs or stands in the folder `stem`.
    pub fn is_part_of(&self, stem: &str) -> bool {
        self.name.strip_prefix(stem).is_some_and(|rest| rest == ".rs" || rest.starts_with('/'))
    }

    /// A message at a line.
    pub fn at(&self, line: usize, message: &str) -> String {
        format!("{}:{line}: {message}", self.name)
    }

    /// Whether a path was written as `crate::…`, so that its first segment must be a module.
    pub fn names_root(&self, path: &PathUse) -> bool {
        path.from_crate
    }

    /// Every path from the root of the crate: `crate::`, enough `super::`, `isolume::`.
    pub fn crate_paths(&self) -> Vec<PathUse> {
        let inside = self.name.trim_start_matches("src/").trim_end_matches(".rs");
        let depth = inside.split('/').filter(|s| *s != "mod").count();
        let mut found = Vec::new();
        let mut at = 0;
        while at < self.tokens.len() {
            let text = |i: usize| self.tokens.get(i).map_or("", |t| t.text.as_str());
            let qualified = at > 0 && text(at - 1) == "::";
            let mut after = at + 1;
            let from_crate = text(at) == "crate" && text(after) == "::";
            let mut rooted = from_crate || (!qualified && text(at) == "isolume" && text(after) == "::");
            if text(at) == "super" && !qualified {
                let mut count = 1;
                while text(after) == "::" && text(after + 1) == "super" {
                    count += 1;
                    after += 2;
                }
                rooted = count >= depth && text(after) == "::";
            }
            if rooted {
                at = self.read_tree(after + 1, &[], from_crate, &mut found);
            } else {
                at += 1;
            }
        }
        found
    }

    /// Every path that starts at `std`, without that.
    pub fn std_paths(&self) -> Vec<PathUse> {
        let mut found = Vec::new();
        for at in 0..self.tokens.len().saturating_sub(1) {
            if self.tokens[at].text == "std" && self.tokens[at + 1].text == "::" {
                self.read_tree(at + 2, &[], false, &mut found);
            }
        }
        found
    }

    /// Reads a use tree or path from `at`, multiplies it out into `found`, returns its end.
    fn read_tree(&self, at: usize, before: &[String], from_crate: bool, found: &mut Vec<PathUse>) -> usize {
        let text = |i: usize| self.tokens.get(i).map_or("", |t| t.text.as_str());
        if text(at) == "{" {
            let mut next = at + 1;
            while next < self.tokens.len() && text(next) != "}" {
                let end = self.read_tree(next, before, from_crate, found);
                // Past `as name` and the comma.
                next =
                    (end.max(next + 1)..self.tokens.len()).find(|&i| text(i) == "," || text(i) == "}").unwrap_or(end);
                next += usize::from(text(next) == ",");
            }
            return next + 1;
        }
        let mut segments = before.to_vec();
        segments.push(text(at).into());
        if text(at + 1) == "::" && (text(at + 2) == "{" || text(at + 2).starts_with(is_word)) {
            return self.read_tree(at + 2, &segments, from_crate, found);
        }
        found.push(PathUse { segments, line: self.tokens.get(at).map_or(0, |t| t.line), from_crate });
        at + 1
    }

    /// Names of the items that are `pub(crate)`, `pub(super)` or `pub(in …)` (`restricted`), or plainly `pub`.
    pub fn items(&self, restricted: bool) -> impl Iterator<Item = &str> {
        let mut names = Vec::new();
        for start in 0..self.tokens.len() {
            let text = |i: usize| self.tokens.get(start + i).map_or("", |t| t.text.as_str());
            if text(0) != "pub" || (text(1) == "(") != restricted {
                continue;
            }
            // After the bracket: `pub(in a::b)` is longer than `pub(crate)`.
            let mut at = if restricted { (2..16).find(|&i| text(i) == ")").map_or(4, |end| end + 1) } else { 1 };
            while ["const", "async", "unsafe", "extern", "\"\""].contains(&text(at)) && text(at + 1) != ":" {
                at += 1;
                if text(at - 1) == "const" && text(at + 1) == ":" {
                    names.push(text(at));
                }
            }
            match text(at) {
                "fn" | "struct" | "enum" | "trait" | "type" | "mod" | "union" => names.push(text(at + 1)),
                "static" => names.push(text(at + if text(at + 1) == "mut" { 2 } else { 1 })),
                "use" => {
                    // The last word of each branch: before a comma, a brace or the end.
                    while ![";", ""].contains(&text(at)) {
                        if text(at).starts_with(is_word) && [",", "}", ";"].contains(&text(at + 1)) {
                            names.push(text(at));
                        }
                        at += 1;
                    }
                }
                _ => {}
            }
        }
        let borrowed: Vec<&str> = self.tokens.iter().map(|t| t.text.as_str()).filter(|t| names.contains(t)).collect();
        borrowed.into_iter()
    }
}

/// Where the item that starts with an attribute at `at` ends: after its `;` or matching brace.
fn item_end(all: &[Token], at: usize) -> usize {
    let mut depth = 0usize;
    for (index, token) in all.iter().enumerate().skip(at) {
        match token.text.as_str() {
            "{" | "(" | "[" => depth += 1,
            "}" | ")" | "]" => {
                depth = depth.saturating_sub(1);
                // The closing brace of a body; a use tree goes on to its semicolon.
                let ends = token.text == "}" && depth == 0 && all.get(index + 1).is_none_or(|t| t.text != ";");
                if ends {
                    return index + 1;
                }
            }
            ";" if depth == 0 => return index + 1,
            _ => {}
        }
    }
    all.len()
}

/// The folder in which the modules declared by a file stand.
fn folder_of_children(name: &str) -> String {
    let (folder, file) = name.rsplit_once('/').unwrap_or(("", name));
    match file {
        "mod.rs" | "lib.rs" | "main.rs" => folder.into(),
        _ => name.trim_end_matches(".rs").into(),
    }
}
