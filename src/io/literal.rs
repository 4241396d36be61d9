//! Python literals, of which the headers of numpy's files are made.

/// A literal.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Literal {
    Text(String),
    Number(i64),
    Bool(bool),
    Tuple(Vec<Literal>),
    List(Vec<Literal>),
    Dict(Vec<(String, Literal)>),
}

/// Deepest nesting that is parsed. Headers of numpy have four levels.
const MAX_DEPTH: usize = 8;

/// Parses a literal; `None` where the text is none.
pub(super) fn parse_literal(text: &str) -> Option<Literal> {
    let mut parser = LiteralParser { rest: text };
    let literal = parser.value(0)?;
    parser.rest.trim().is_empty().then_some(literal)
}

struct LiteralParser<'a> {
    rest: &'a str,
}

impl LiteralParser<'_> {
    fn value(&mut self, depth: usize) -> Option<Literal> {
        if depth > MAX_DEPTH {
            return None;
        }
        self.rest = self.rest.trim_start();
        match self.rest.chars().next()? {
            '\'' | '"' => self.text().map(Literal::Text),
            '(' => self.items(')', depth).map(Literal::Tuple),
            '[' => self.items(']', depth).map(Literal::List),
            '{' => self.entries(depth).map(Literal::Dict),
            _ => self.word(),
        }
    }

    fn text(&mut self) -> Option<String> {
        let quote = self.rest.chars().next()?;
        let (text, rest) = self.rest[1..].split_once(quote)?;
        self.rest = rest;
        // Escapes are in no header that numpy writes for plain names.
        (!text.contains('\\')).then(|| text.into())
    }

    fn word(&mut self) -> Option<Literal> {
        let end = self.rest.find(|c: char| !c.is_alphanumeric() && c != '-');
        let (word, rest) = self.rest.split_at(end.unwrap_or(self.rest.len()));
        self.rest = rest;
        match word {
            "True" => Some(Literal::Bool(true)),
            "False" => Some(Literal::Bool(false)),
            _ => word.trim_end_matches('L').parse().ok().map(Literal::Number),
        }
    }

    /// Returns whether `letter` comes next, and takes it.
    fn takes(&mut self, letter: char) -> bool {
        let rest = self.rest.trim_start().strip_prefix(letter);
        self.rest = rest.unwrap_or(self.rest);
        rest.is_some()
    }

    fn items(&mut self, close: char, depth: usize) -> Option<Vec<Literal>> {
        self.rest = &self.rest[1..];
        let mut items = Vec::new();
        loop {
            if self.takes(close) {
                return Some(items);
            }
            items.push(self.value(depth + 1)?);
            if !self.takes(',') {
                return self.takes(close).then_some(items);
            }
        }
    }

    fn entries(&mut self, depth: usize) -> Option<Vec<(String, Literal)>> {
        self.rest = &self.rest[1..];
        let mut entries = Vec::new();
        loop {
            if self.takes('}') {
                return Some(entries);
            }
            self.rest = self.rest.trim_start();
            let key = self.rest.starts_with(['\'', '"']).then(|| self.text()).flatten()?;
            let value = self.takes(':').then(|| self.value(depth + 1)).flatten()?;
            entries.push((key, value));
            if !self.takes(',') {
                return self.takes('}').then_some(entries);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_of_numpy_are_parsed() {
        let header = "{'descr': [('x', '<f4'), ('c', '|u1', (3,))], 'fortran_order': False, \
                      'shape': (7,), }   \n";
        let Some(Literal::Dict(entries)) = parse_literal(header) else { panic!() };
        let names: Vec<&str> = entries.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["descr", "fortran_order", "shape"]);
        assert_eq!(entries[1].1, Literal::Bool(false));
        assert_eq!(entries[2].1, Literal::Tuple(vec![Literal::Number(7)]));
        for broken in ["{'a': 1", "{'a' 1}", "(1, 2", "'a", "{'a': (1,)} more", &"[".repeat(99)] {
            assert_eq!(parse_literal(broken), None, "{broken}");
        }
    }
}
