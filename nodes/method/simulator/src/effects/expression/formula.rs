//! Formula: a text such as `2 * s^2 * sin(2 * pi * t)` that is read once and evaluated often.
//!
//! Signs and powers bind as in mathematics: `-x^2` is minus the square, and `2^3^2` is 512. The libraries for this that are
//! kept up and free to use (exmex 0.21) read the first as a positive square, the second as 64, and `1e-3` not at all.

use catenary_core::spelling::did_you_mean;

/// Greatest number of parentheses, signs and powers within one another. Deeper texts are accidents, and would exhaust the stack.
const MOST_DEPTH: usize = 60;

/// Function of one argument.
type Function = fn(f64) -> f64;

/// Function of two arguments.
type FunctionOfTwo = fn(f64, f64) -> f64;

/// Operator between two operands.
type Operator = fn(Box<Part>, Box<Part>) -> Part;

/// Functions of one argument by name.
const FUNCTIONS: [(&str, Function); 16] = [
    ("sin", f64::sin),
    ("cos", f64::cos),
    ("tan", f64::tan),
    ("asin", f64::asin),
    ("acos", f64::acos),
    ("atan", f64::atan),
    ("sinh", f64::sinh),
    ("cosh", f64::cosh),
    ("tanh", f64::tanh),
    ("exp", f64::exp),
    ("ln", f64::ln),
    ("log10", f64::log10),
    ("sqrt", f64::sqrt),
    ("abs", f64::abs),
    ("sign", |v| if v == 0.0 { 0.0 } else { v.signum() }),
    ("step", |v| if v > 0.0 { 1.0 } else { 0.0 }),
];

/// Functions of two arguments by name.
const FUNCTIONS_OF_TWO: [(&str, FunctionOfTwo); 3] = [("min", f64::min), ("max", f64::max), ("atan2", f64::atan2)];

/// Part of a formula. Variables are places in the list of names with which it was read.
#[derive(Debug, Clone)]
enum Part {
    Number(f64),
    Variable(usize),
    Negative(Box<Part>),
    Sum(Box<Part>, Box<Part>),
    Difference(Box<Part>, Box<Part>),
    Product(Box<Part>, Box<Part>),
    Quotient(Box<Part>, Box<Part>),
    Power(Box<Part>, Box<Part>),
    Function(Function, Box<Part>),
    FunctionOfTwo(FunctionOfTwo, Box<Part>, Box<Part>),
}

impl Part {
    fn value(&self, state: &[f64], numbers: &[f64]) -> f64 {
        let of = |part: &Part| part.value(state, numbers);
        match self {
            Part::Number(value) => *value,
            Part::Variable(place) => state.get(*place).copied().unwrap_or_else(|| numbers[*place - state.len()]),
            Part::Negative(a) => -of(a),
            Part::Sum(a, b) => of(a) + of(b),
            Part::Difference(a, b) => of(a) - of(b),
            Part::Product(a, b) => of(a) * of(b),
            Part::Quotient(a, b) => of(a) / of(b),
            Part::Power(a, b) => of(a).powf(of(b)),
            Part::Function(f, a) => f(of(a)),
            Part::FunctionOfTwo(f, a, b) => f(of(a), of(b)),
        }
    }
}

/// Formula of named variables.
#[derive(Debug, Clone)]
pub struct Formula {
    root: Part,
    variables: usize,
}

impl Formula {
    /// Reads `text`. `names` are the variables that it may use.
    ///
    /// # Errors
    /// A sentence that says at which character something else was expected.
    pub fn read(text: &str, names: &[&str]) -> Result<Self, String> {
        let mut reader = Reader { text, at: 0, names, depth: 0 };
        let root = reader.sum()?;
        match reader.peek() {
            None => Ok(Self { root, variables: names.len() }),
            Some(_) => Err(reader.expected("an operator or the end")),
        }
    }

    /// Returns the value at a state and at numbers that follow it, in the order of the names with which the text was read.
    ///
    /// # Panics
    /// Panics if there are fewer values than names.
    pub fn value(&self, state: &[f64], numbers: &[f64]) -> f64 {
        let values = state.len() + numbers.len();
        assert!(values >= self.variables, "{values} values for {} names", self.variables);
        self.root.value(state, numbers)
    }
}

/// Reader of a text by recursive descent.
struct Reader<'a> {
    text: &'a str,
    /// Next byte.
    at: usize,
    names: &'a [&'a str],
    depth: usize,
}

impl Reader<'_> {
    fn rest(&self) -> &str {
        &self.text[self.at..]
    }

    /// Skips spaces, and returns the next character.
    fn peek(&mut self) -> Option<char> {
        self.at += self.rest().len() - self.rest().trim_start().len();
        self.rest().chars().next()
    }

    /// Skips `sign` if it is next.
    fn takes(&mut self, sign: &str) -> bool {
        self.peek();
        let is_next = self.rest().starts_with(sign);
        self.at += if is_next { sign.len() } else { 0 };
        is_next
    }

    fn expected(&mut self, what: &str) -> String {
        let got = self.peek().map_or("the end".to_owned(), |c| format!("`{c}`"));
        format!("at character {}: expected {what}, got {got}", 1 + self.text[..self.at].chars().count())
    }

    /// Reads a part within others, unless these are too many.
    fn within(&mut self, read: impl FnOnce(&mut Self) -> Result<Part, String>) -> Result<Part, String> {
        if self.depth == MOST_DEPTH {
            return Err(format!("expected at most {MOST_DEPTH} parentheses, signs and powers within one another"));
        }
        self.depth += 1;
        let part = read(self)?;
        self.depth -= 1;
        Ok(part)
    }

    fn sum(&mut self) -> Result<Part, String> {
        self.within(|reader| reader.chain(Self::product, [("+", Part::Sum), ("-", Part::Difference)]))
    }

    fn product(&mut self) -> Result<Part, String> {
        self.chain(Self::signed, [("*", Part::Product), ("/", Part::Quotient)])
    }

    /// Reads operands between operators that bind from left to right.
    fn chain(
        &mut self,
        operand: fn(&mut Self) -> Result<Part, String>,
        operators: [(&str, Operator); 2],
    ) -> Result<Part, String> {
        let mut chain = operand(self)?;
        while let Some((_, operator)) = operators.iter().find(|(sign, _)| self.takes(sign)) {
            chain = operator(Box::new(chain), Box::new(operand(self)?));
        }
        Ok(chain)
    }

    fn signed(&mut self) -> Result<Part, String> {
        self.within(|reader| {
            if reader.takes("-") {
                return Ok(Part::Negative(Box::new(reader.signed()?)));
            }
            if reader.takes("+") {
                return reader.signed();
            }
            let base = reader.operand()?;
            // Both spellings of a power are common: that of mathematics, and Python's.
            match reader.takes("^") || reader.takes("**") {
                true => Ok(Part::Power(Box::new(base), Box::new(reader.signed()?))),
                false => Ok(base),
            }
        })
    }

    fn operand(&mut self) -> Result<Part, String> {
        match self.peek() {
            Some('(') => self.in_parentheses(),
            Some(c) if c.is_ascii_digit() || c == '.' => self.number(),
            Some(c) if c.is_alphabetic() || c == '_' => self.named(),
            _ => Err(self.expected("a number, a name or `(`")),
        }
    }

    fn in_parentheses(&mut self) -> Result<Part, String> {
        self.takes("(");
        let part = self.sum()?;
        if self.takes(")") { Ok(part) } else { Err(self.expected("an operator or `)`")) }
    }

    fn number(&mut self) -> Result<Part, String> {
        let digits = |text: &str| text.chars().take_while(char::is_ascii_digit).count();
        let text = self.rest();
        let mut end = digits(text);
        if text[end..].starts_with('.') {
            end += 1 + digits(&text[end + 1..]);
        }
        if text[end..].starts_with(['e', 'E']) {
            let sign = usize::from(text[end + 1..].starts_with(['+', '-']));
            let exponent = digits(&text[end + 1 + sign..]);
            end += if exponent > 0 { 1 + sign + exponent } else { 0 };
        }
        match text[..end].parse() {
            Ok(value) => {
                self.at += end;
                Ok(Part::Number(value))
            }
            Err(_) => Err(self.expected("a number")),
        }
    }

    fn named(&mut self) -> Result<Part, String> {
        let begin = self.at;
        let text = self.rest();
        let length = text.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(text.len());
        let name = text[..length].to_owned();
        self.at += length;
        if let Some(place) = self.names.iter().position(|n| *n == name) {
            return Ok(Part::Variable(place));
        }
        if name == "pi" {
            return Ok(Part::Number(std::f64::consts::PI));
        }
        if let Some((_, f)) = FUNCTIONS.iter().find(|(n, _)| *n == name) {
            return self.argument_of(&name).map(|a| Part::Function(*f, Box::new(a)));
        }
        if let Some((_, f)) = FUNCTIONS_OF_TWO.iter().find(|(n, _)| *n == name) {
            return self.arguments_of(&name).map(|[a, b]| Part::FunctionOfTwo(*f, Box::new(a), Box::new(b)));
        }
        let functions = FUNCTIONS.iter().map(|f| f.0).chain(FUNCTIONS_OF_TWO.iter().map(|f| f.0));
        let known: Vec<&str> = self.names.iter().copied().chain(["pi"]).chain(functions).collect();
        let hint = did_you_mean(&name, known.iter().copied());
        let place = 1 + self.text[..begin].chars().count();
        Err(format!("at character {place}: expected one of {}, got `{name}`{hint}", known.join(", ")))
    }

    fn argument_of(&mut self, name: &str) -> Result<Part, String> {
        match self.peek() {
            Some('(') => self.in_parentheses(),
            _ => Err(self.expected(&format!("`(` after {name}"))),
        }
    }

    fn arguments_of(&mut self, name: &str) -> Result<[Part; 2], String> {
        let what = format!("two arguments, {name}(a, b)");
        if !self.takes("(") {
            return Err(self.expected(&what));
        }
        let first = self.sum()?;
        if !self.takes(",") {
            return Err(self.expected(&what));
        }
        let second = self.sum()?;
        if self.takes(")") { Ok([first, second]) } else { Err(self.expected(&what)) }
    }
}

#[cfg(test)]
mod tests {
    use super::Formula;

    const NAMES: [&str; 3] = ["x", "vx", "speed"];

    fn value(text: &str) -> f64 {
        Formula::read(text, &NAMES).unwrap().value(&[3.0], &[0.5, 0.5])
    }

    fn error(text: &str) -> String {
        Formula::read(text, &NAMES).unwrap_err()
    }

    #[test]
    fn operators_bind_as_in_mathematics() {
        for (text, expected) in [
            ("-x^2", -9.0),
            ("2^3^2", 512.0),
            ("2^-1", 0.5),
            ("2**3", 8.0),
            ("2*-x^2", -18.0),
            ("x/2*3", 4.5),
            ("1-2-3", -4.0),
            ("1 - 2 + 3", 2.0),
            ("1e-3*x", 3e-3),
            ("1.5E+2", 150.0),
            (".5", 0.5),
            ("--x", 3.0),
            ("(1+x)*vx", 2.0),
            ("max(0, x-1)*min(x,2)", 4.0),
            ("sin(2*pi*x) + atan2(0, 1)", 0.0),
            ("sign(vx)*abs(-vx)^2", 0.25),
            ("sign(0) + step(0) + step(2)", 1.0),
        ] {
            assert!((value(text) - expected).abs() < 1e-12, "{text}: {}", value(text));
        }
    }

    #[test]
    fn errors_name_the_character_and_what_was_expected() {
        assert_eq!(error("2*"), "at character 3: expected a number, a name or `(`, got the end");
        assert_eq!(error("2 x"), "at character 3: expected an operator or the end, got `x`");
        assert_eq!(error("(x"), "at character 3: expected an operator or `)`, got the end");
        assert_eq!(error("max(x)"), "at character 6: expected two arguments, max(a, b), got `)`");
        assert_eq!(error("sin x"), "at character 5: expected `(` after sin, got `x`");
        assert_eq!(error(""), "at character 1: expected a number, a name or `(`, got the end");
        assert_eq!(error("x ü"), "at character 3: expected an operator or the end, got `ü`");
        assert!(error("2*speeed").ends_with("got `speeed`; did you mean `speed`?"), "{}", error("2*speeed"));
        assert!(error("x > 1").starts_with("at character 3: expected an operator"), "{}", error("x > 1"));
    }

    /// Ten thousand parentheses do not exhaust the stack.
    #[test]
    fn a_deep_text_is_refused() {
        for open in ["(", "-", "sin(", "2^"] {
            assert!(error(&open.repeat(10_000)).contains("at most 60"), "{open}");
        }
    }
}
