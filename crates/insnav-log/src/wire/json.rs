//! JSON (\[RFC8259\]), and the NaN and Infinity that Python and others write all the same.
//!
//! A reader of our own: numbers are rounded correctly to the last bit, which the common fast parsers do not do, and the
//! tree's memory is kept, so that a log of a million messages allocates nothing.

use super::DecodeError;
use super::document::{Document, Fields, Span, Value};

/// Messages are not nested deeper.
const DEEPEST: usize = 64;

/// The fields of a message in JSON, which has to be an object.
pub fn read_json<'a>(
    document: &'a mut Document,
    message: &'a [u8],
) -> Result<Fields<'a>, DecodeError> {
    document.clear();
    let mut parser = Parser {
        text: message,
        at: 0,
        document,
    };
    parser.space();
    if parser.peek() != Some(b'{') {
        return Err(parser.expected("an object in braces"));
    }
    parser.value(Span::default(), DEEPEST)?;
    parser.space();
    // Some writers end a message with a NUL or a newline.
    if parser.text[parser.at..].iter().any(|b| *b != 0) {
        return Err(parser.expected("the end of the message"));
    }
    Ok(document.fields(message, message))
}

struct Parser<'a, 'd> {
    text: &'a [u8],
    at: usize,
    document: &'d mut Document,
}

impl Parser<'_, '_> {
    #[inline]
    fn peek(&self) -> Option<u8> {
        self.text.get(self.at).copied()
    }

    #[inline]
    fn space(&mut self) {
        while matches!(self.peek(), Some(b' ' | b'\t' | b'\n' | b'\r')) {
            self.at += 1;
        }
    }

    #[cold]
    fn expected(&self, expected: &'static str) -> DecodeError {
        DecodeError::Json {
            at: self.at,
            expected,
        }
    }

    #[inline]
    fn take(&mut self, byte: u8, expected: &'static str) -> Result<(), DecodeError> {
        if self.peek() == Some(byte) {
            self.at += 1;
            Ok(())
        } else {
            Err(self.expected(expected))
        }
    }

    fn value(&mut self, key: Span, depth: usize) -> Result<(), DecodeError> {
        if depth == 0 {
            return Err(DecodeError::TooMuch("64 levels"));
        }
        let value = match self.peek() {
            Some(b'{') => return self.object(key, depth),
            Some(b'[') => return self.array(key, depth),
            Some(b'"') => self.text()?,
            Some(b'-' | b'0'..=b'9') => self.number()?,
            _ => self.word()?,
        };
        self.document.push(key, value).map(drop)
    }

    fn object(&mut self, key: Span, depth: usize) -> Result<(), DecodeError> {
        let index = self.document.push(key, Value::Object)?;
        self.at += 1;
        self.space();
        if self.peek() == Some(b'}') {
            self.at += 1;
            return Ok(());
        }
        loop {
            self.space();
            let name = self.quoted()?.0;
            self.space();
            self.take(b':', "a colon")?;
            self.space();
            self.value(name, depth - 1)?;
            self.space();
            if self.peek() == Some(b'}') {
                self.at += 1;
                self.document.close(index);
                return Ok(());
            }
            self.take(b',', "a comma or a closing brace")?;
        }
    }

    fn array(&mut self, key: Span, depth: usize) -> Result<(), DecodeError> {
        let index = self.document.push(key, Value::Array)?;
        self.at += 1;
        self.space();
        if self.peek() == Some(b']') {
            self.at += 1;
            return Ok(());
        }
        loop {
            self.space();
            self.value(Span::default(), depth - 1)?;
            self.space();
            if self.peek() == Some(b']') {
                self.at += 1;
                self.document.close(index);
                return Ok(());
            }
            self.take(b',', "a comma or a closing bracket")?;
        }
    }

    /// What is between quotes, as it stands, and whether there are escapes in it.
    fn quoted(&mut self) -> Result<(Span, bool), DecodeError> {
        self.take(b'"', "a name or text in quotes")?;
        let start = self.at;
        let mut escapes = false;
        loop {
            match self.peek() {
                Some(b'"') => break,
                Some(b'\\') => {
                    escapes = true;
                    self.at += 2;
                }
                Some(0..0x20) | None => return Err(self.expected("the closing quote")),
                _ => self.at += 1,
            }
        }
        let span = Span::new(start, self.at);
        self.at += 1;
        Ok((span, escapes))
    }

    fn text(&mut self) -> Result<Value, DecodeError> {
        let start = self.at + 1;
        let (span, escapes) = self.quoted()?;
        if !escapes {
            return Ok(Value::Text(span));
        }
        let bad = || DecodeError::BadString { at: start };
        let raw = core::str::from_utf8(&self.text[start..self.at - 1]).map_err(|_| bad())?;
        let out = self.document.unescaped();
        let begin = out.len();
        let mut rest = raw.chars();
        while let Some(letter) = rest.next() {
            if letter != '\\' {
                out.push(letter);
                continue;
            }
            out.push(match rest.next().ok_or_else(bad)? {
                'n' => '\n',
                't' => '\t',
                'r' => '\r',
                'b' => '\u{8}',
                'f' => '\u{c}',
                'u' => {
                    let high = hex(&mut rest).ok_or_else(bad)?;
                    // Beyond the basic plane, a letter is two of these.
                    let code = if (0xd800..0xdc00).contains(&high) {
                        let low = match (rest.next(), rest.next()) {
                            (Some('\\'), Some('u')) => hex(&mut rest).ok_or_else(bad)?,
                            _ => return Err(bad()),
                        };
                        let low = low.checked_sub(0xdc00).filter(|low| *low < 0x400);
                        0x10000 + ((high - 0xd800) << 10) + low.ok_or_else(bad)?
                    } else {
                        high
                    };
                    char::from_u32(code).ok_or_else(bad)?
                }
                same @ ('"' | '\\' | '/') => same,
                _ => return Err(bad()),
            });
        }
        let end = out.len();
        Ok(Value::Unescaped(Span::new(begin, end)))
    }

    fn number(&mut self) -> Result<Value, DecodeError> {
        let start = self.at;
        let mut whole = true;
        while let Some(byte) = self.peek() {
            match byte {
                b'0'..=b'9' | b'-' => {}
                b'+' | b'.' | b'e' | b'E' => whole = false,
                // -Infinity, as Python has it.
                b'I' if self.at == start + 1 => {
                    self.at = start;
                    return self.word();
                }
                _ => break,
            }
            self.at += 1;
        }
        let text = core::str::from_utf8(&self.text[start..self.at]).unwrap_or_default();
        // A zero keeps its sign only as a floating-point number.
        if whole
            && text != "-0"
            && let Ok(integer) = text.parse()
        {
            return Ok(Value::Integer(integer));
        }
        // Rust's own reading rounds to nearest, ties to even, always.
        match text.parse() {
            Ok(number) => Ok(Value::Float(number)),
            Err(_) => {
                self.at = start;
                Err(self.expected("a number"))
            }
        }
    }

    fn word(&mut self) -> Result<Value, DecodeError> {
        const WORDS: [(&[u8], Value); 6] = [
            (b"true", Value::Bool(true)),
            (b"false", Value::Bool(false)),
            (b"null", Value::Null),
            (b"NaN", Value::Float(f64::NAN)),
            (b"Infinity", Value::Float(f64::INFINITY)),
            (b"-Infinity", Value::Float(f64::NEG_INFINITY)),
        ];
        let rest = &self.text[self.at..];
        match WORDS.iter().find(|(word, _)| rest.starts_with(word)) {
            Some((word, value)) => {
                self.at += word.len();
                Ok(*value)
            }
            None => Err(self.expected("a value")),
        }
    }
}

fn hex(rest: &mut core::str::Chars<'_>) -> Option<u32> {
    (0..4).try_fold(0, |code, _| Some(code << 4 | rest.next()?.to_digit(16)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::Wire;
    use proptest::prelude::*;

    #[test]
    fn every_double_comes_back_to_the_bit() {
        let mut document = Document::default();
        for number in [
            0.1,
            -0.0,
            5e-324,
            f64::MAX,
            2.225_073_858_507_201e-308,
            9007199254740993.0,
            -0.0183258,
        ] {
            let text = format!("{{\"a\":{number:?}}}");
            let mut fields = read_json(&mut document, text.as_bytes()).unwrap();
            assert_eq!(
                fields.f64("a").unwrap().to_bits(),
                number.to_bits(),
                "{text}"
            );
        }
        // Halfway cases, in which fast parsers go wrong: the digits are exactly between two doubles, or just beside.
        let text =
            br#"{"a": 9007199254740993, "b": 9007199254740993.0000000001, "c": -0, "d": 1e400}"#;
        let mut fields = read_json(&mut document, text).unwrap();
        assert_eq!(fields.f64("a"), Ok(9007199254740992.0));
        assert_eq!(fields.f64("b"), Ok(9007199254740994.0));
        assert_eq!(fields.f64("c").unwrap().to_bits(), (-0.0f64).to_bits());
        assert_eq!(fields.f64("d"), Ok(f64::INFINITY));
    }

    #[test]
    fn words_and_escapes() {
        let mut document = Document::default();
        let text = br#" {"a": NaN, "b": -Infinity, "c": null, "d": true, "e": "a\/b\"\u00e9\ud83d\ude00\n", "f": {}, "g": []} "#;
        let mut fields = read_json(&mut document, text).unwrap();
        assert!(fields.f64("a").unwrap().is_nan() && fields.f64("c").unwrap().is_nan());
        assert_eq!(fields.f64("b"), Ok(f64::NEG_INFINITY));
        assert_eq!(fields.u8("d"), Ok(1));
        assert_eq!(fields.string("e"), Ok("a/b\"é😀\n"));
        assert!(fields.has("g") && fields.has("f") && !fields.has("h"));
    }

    #[test]
    fn what_is_no_json_is_refused_where_it_goes_wrong() {
        let mut document = Document::default();
        for (text, at) in [
            ("", 0),
            ("[1]", 0),
            ("{\"a\" 1}", 5),
            ("{\"a\": 1", 7),
            ("{\"a\": 1}}", 8),
            ("{\"a\": 1e}", 6),
            ("{\"a\": yes}", 6),
            ("{\"a\": \"", 7),
            ("{a: 1}", 1),
        ] {
            match read_json(&mut document, text.as_bytes()) {
                Err(DecodeError::Json { at: found, .. }) => assert_eq!(found, at, "{text}"),
                other => panic!("{text}: {other:?}"),
            }
        }
        let deep = format!("{}1", "{\"a\":".repeat(100));
        assert_eq!(
            read_json(&mut document, deep.as_bytes()).unwrap_err(),
            DecodeError::TooMuch("64 levels")
        );
        for wrong in [r#"{"a": "\x"}"#, r#"{"a": "\ud800"}"#, r#"{"a": "\u12"}"#] {
            assert!(
                read_json(&mut document, wrong.as_bytes()).is_err(),
                "{wrong}"
            );
        }
    }

    proptest! {
        #[test]
        fn no_text_makes_it_panic(text in "[\\[\\]{}:,\"\\\\a0-9eE.+-]{0,60}") {
            let mut document = Document::default();
            let _ = read_json(&mut document, text.as_bytes());
        }

        #[test]
        fn any_double_there_and_back(number in any::<f64>()) {
            let mut document = Document::default();
            let text = if number.is_nan() { "{\"a\": NaN}".to_owned() } else if number.is_infinite() {
                format!("{{\"a\": {}Infinity}}", if number < 0.0 { "-" } else { "" })
            } else {
                format!("{{\"a\": {number:?}}}")
            };
            let back = read_json(&mut document, text.as_bytes()).unwrap().f64("a").unwrap();
            prop_assert!(back.to_bits() == number.to_bits() || (back.is_nan() && number.is_nan()));
        }
    }
}
