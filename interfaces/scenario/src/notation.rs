//! Notations of other programs in a text that is not TOML: typographic quotation marks, units, decimal commas, semicolons,
//! invisible characters.

use crate::diagnostic::{DiagnosticText, invisible_name, quoted};
use std::iter::repeat_n;
use std::ops::Range;

/// Maximum number of strings in foreign quotation marks that are reported.
const MAX_STRINGS: usize = 100;

/// Notation of another program, with the bytes that it takes.
pub struct ForeignNotation {
    pub span: Range<usize>,
    pub text: DiagnosticText,
}

/// Kind of a foreign value: problem and expected notation.
#[derive(Clone, Copy, PartialEq)]
struct ValueKind(&'static str, &'static str);

const COMMA: ValueKind = ValueKind("decimal comma", "a decimal point");
const SEMICOLON: ValueKind =
    ValueKind("semicolon", "commas between entries, nothing after a value");
const UNIT: ValueKind = ValueKind("value with a unit", "the number alone, in the unit of the key");
const MINUS: ValueKind = ValueKind("dash before a number", "a minus sign");
const ZEROS: ValueKind = ValueKind("unexpected leading zero", "a number without zeros before it");
const POINT: ValueKind = ValueKind("point without digits on a side", "digits on both sides");
const WORD: ValueKind = ValueKind("text without quotes", "a text in quotes");
const BOOLEAN: ValueKind = ValueKind("unknown word", "true or false");

/// Quotation marks, primes and accents that stand where TOML has `"` or `'`.
const QUOTATION_MARKS: &str = "“”„‟«»‹›‘’‚‛′″＂＇`´";
/// Dashes that stand where TOML has a minus sign.
const DASHES: &str = "−–‒—﹣－";
/// Units in the names of keys, longest first.
const KEY_UNITS: [&str; 11] = [
    "N_m_per_rad",
    "N_s_per_m",
    "kg_per_m3",
    "m_per_s2",
    "m_per_s",
    "N_per_m",
    "kg",
    "Hz",
    "N",
    "s",
    "m",
];
/// Units with the unit of a key, and their ratio as a fraction.
const CONVERSIONS: [(&str, &str, f64, f64); 16] = [
    ("ms", "s", 1.0, 1e3),
    ("us", "s", 1.0, 1e6),
    ("µs", "s", 1.0, 1e6),
    ("min", "s", 60.0, 1.0),
    ("mm", "m", 1.0, 1e3),
    ("cm", "m", 1.0, 1e2),
    ("mm/s", "m/s", 1.0, 1e3),
    ("kN", "N", 1e3, 1.0),
    ("kHz", "Hz", 1e3, 1.0),
    ("g", "kg", 1.0, 1e3),
    ("t", "kg", 1e3, 1.0),
    ("g/cm3", "kg/m3", 1e3, 1.0),
    ("t/m3", "kg/m3", 1e3, 1.0),
    ("kN/m", "N/m", 1e3, 1.0),
    ("N/mm", "N/m", 1e3, 1.0),
    ("MN/m", "N/m", 1e6, 1.0),
];

/// Returns all foreign quotation marks and invisible characters of `text`, and the foreign values on the lines of the bytes
/// `errors`, in the order of the text.
pub fn find(text: &str, errors: &[usize]) -> Vec<ForeignNotation> {
    let (masked, mut found) = mask(text);
    let mut start = 0;
    for line in masked.split_inclusive('\n') {
        let span = start..start + line.len();
        start = span.end;
        if !errors.iter().any(|at| span.contains(at) || (*at == text.len() && span.end == *at)) {
            continue;
        }
        if let Some(value) = foreign_value(text, line, span.start) {
            // The value includes its invisible characters.
            found.retain(|n| !value.span.contains(&n.span.start) || n.text.hint.is_none());
            found.push(value);
        }
    }
    found.sort_by_key(|notation| notation.span.start);
    found
}

/// Returns the text with comments, strings and invisible characters overwritten by ASCII characters of the same length, and
/// the notations among them.
fn mask(text: &str) -> (String, Vec<ForeignNotation>) {
    let mut masked = String::with_capacity(text.len());
    let mut found = Vec::new();
    let mut invisible: Vec<(char, usize, usize)> = Vec::new();
    while masked.len() < text.len() {
        let at = masked.len();
        let rest = &text[at..];
        let Some(c) = rest.chars().next() else { break };
        let (length, filler) = match c {
            '#' => (rest.find('\n').unwrap_or(rest.len()), ' '),
            '"'
            | '\''
            | '`'
            | '´'
            | '‘'..='‟'
            | '′'
            | '″'
            | '«'
            | '»'
            | '‹'
            | '›'
            | '＂'
            | '＇' => {
                let (length, is_foreign) = string_length(rest, c);
                if is_foreign && found.len() < MAX_STRINGS {
                    found.push(foreign_quotes(at, &rest[..length]));
                }
                (length, '"')
            }
            _ if invisible_name(c).is_some() => {
                match invisible.iter_mut().find(|(known, ..)| *known == c) {
                    Some((.., count)) => *count += 1,
                    // A byte order mark is allowed at the start.
                    None if at == 0 && c == '\u{feff}' => {}
                    None => invisible.push((c, at, 1)),
                }
                (c.len_utf8(), ' ')
            }
            _ => {
                masked.push(c);
                continue;
            }
        };
        masked.extend(repeat_n(filler, length));
    }
    found.extend(invisible.into_iter().map(|(c, at, count)| invisible_notation(c, at, count)));
    (masked, found)
}

/// Returns the length of the string that begins with the quotation mark `quote`, and whether its marks are foreign.
fn string_length(rest: &str, quote: char) -> (usize, bool) {
    let is_toml = matches!(quote, '"' | '\'');
    let triple = quote.to_string().repeat(3);
    if is_toml && let Some(inner) = rest.strip_prefix(&triple) {
        return (inner.find(&triple).map_or(rest.len(), |end| end + 6), false);
    }
    let line = rest.lines().next().unwrap_or(rest);
    let mut is_escaped = false;
    let mut foreign_end = None;
    for (i, c) in line.char_indices().skip(1) {
        let closes = c == quote || (!is_toml && c == '"');
        if is_toml && closes && !is_escaped {
            return (i + c.len_utf8(), false);
        }
        if foreign_end.is_none() && (QUOTATION_MARKS.contains(c) || closes) {
            foreign_end = Some(i + c.len_utf8());
        }
        is_escaped = quote == '"' && c == '\\' && !is_escaped;
    }
    match foreign_end {
        Some(end) => (end, true),
        None => (line.len(), !is_toml),
    }
}

fn foreign_quotes(at: usize, string: &str) -> ForeignNotation {
    let is_mark = |c: char| QUOTATION_MARKS.contains(c) || matches!(c, '"' | '\'');
    let content = string.trim_matches(is_mark).trim();
    let expected = match content.contains(['"', '\\']) {
        true => format!("straight quotation marks: '{content}'"),
        false => format!("straight quotation marks: \"{content}\""),
    };
    let text = DiagnosticText {
        problem: "not TOML: typographic quotation marks".into(),
        found: quoted(string),
        expected,
        hint: None,
    };
    ForeignNotation { span: at..at + string.len(), text }
}

fn invisible_notation(c: char, at: usize, count: usize) -> ForeignNotation {
    let name = invisible_name(c).unwrap_or_default();
    let more = match count {
        1 => "often comes with text that is copied from a page or a word processor".into(),
        _ => format!("the file has {count} of them outside of strings and comments; replace all"),
    };
    let text = DiagnosticText {
        problem: format!("not TOML: {name}"),
        found: format!("U+{:04X}", u32::from(c)),
        expected: match name.ends_with("space") && !name.starts_with("zero") {
            true => "a plain space".into(),
            false => "no such character".into(),
        },
        hint: Some(more),
    };
    ForeignNotation { span: at..at + c.len_utf8(), text }
}

/// Value in foreign notation, rewritten.
#[derive(Default)]
struct RewrittenValue {
    text: String,
    kinds: Vec<ValueKind>,
    has_unknown_unit: bool,
}

/// Returns the value on a line, if it is in a foreign notation; `line` is masked and begins at the byte `start` of `text`.
fn foreign_value(text: &str, line: &str, start: usize) -> Option<ForeignNotation> {
    let key = line.split_once('=').map(|(key, _)| key.trim());
    let region = key.map_or(0, |_| line.find('=').map_or(0, |at| at + 1));
    let value = line[region..].trim();
    let from = region + line[region..].find(value)?;
    let span = start + from..start + from + value.len();
    let original = &text[span.clone()];
    let rewritten = rewrite(original, value, key);
    if rewritten.kinds.is_empty() {
        return None;
    }
    let join = |part: fn(&ValueKind) -> &'static str| {
        rewritten.kinds.iter().map(part).collect::<Vec<_>>().join(" and ")
    };
    let expected = join(|kind| kind.1);
    let text = DiagnosticText {
        problem: format!("not TOML: {}", join(|kind| kind.0)),
        found: quoted(original),
        expected: match rewritten.has_unknown_unit {
            true => expected,
            false => format!("{expected}: {}", rewritten.text),
        },
        hint: None,
    };
    Some(ForeignNotation { span, text })
}

/// Rewrites each entry of a value; `masked` is the value without contents of strings.
fn rewrite(original: &str, masked: &str, key: Option<&str>) -> RewrittenValue {
    let mut value = RewrittenValue::default();
    let is_digit = |byte: Option<&u8>| byte.is_some_and(u8::is_ascii_digit);
    let bytes = masked.as_bytes();
    // Open brackets with the byte after each. A line without a key continues a list.
    let mut open = if key.is_some() { vec![] } else { vec![('[', 0)] };
    let mut key = key.map(str::to_string);
    let mut begin = 0;
    for (i, c) in masked.char_indices().chain([(masked.len(), '\n')]) {
        let is_dense =
            c == ',' && i > 0 && is_digit(bytes.get(i - 1)) && is_digit(bytes.get(i + 1));
        if !"[]{};,=\n".contains(c) || (is_dense && is_decimal_comma(masked, open.last().copied()))
        {
            continue;
        }
        let entry = &masked[begin..i];
        let is_list = matches!(open.last(), Some(('[', _)));
        if c == '=' {
            key = Some(entry.trim().to_string());
            value.text += &original[begin..i];
        } else {
            rewrite_entry(&original[begin..i], entry, key.as_deref(), is_list, &mut value);
        }
        match c {
            '[' | '{' => open.push((c, i + 1)),
            ']' | '}' => drop(open.pop()),
            _ => {}
        }
        match c {
            '\n' => {}
            ';' => {
                add_kind(&mut value, SEMICOLON);
                value.text += if open.is_empty() { "" } else { "," };
            }
            c => value.text.push(c),
        }
        begin = (i + 1).min(masked.len());
    }
    value
}

/// True if a comma between two digits is a decimal comma: in `[0,3, 0,2]`, but not in `[0,3,0,2]`.
fn is_decimal_comma(masked: &str, innermost: Option<(char, usize)>) -> bool {
    let Some(('[', start)) = innermost else { return true };
    let list = &masked[start..];
    let list = list.split(']').next().unwrap_or(list);
    list.contains(';') || list.contains(", ")
}

fn add_kind(value: &mut RewrittenValue, kind: ValueKind) {
    if !value.kinds.contains(&kind) {
        value.kinds.push(kind);
    }
}

/// Appends an entry of a value; `masked` is the entry without contents of strings.
fn rewrite_entry(
    original: &str,
    masked: &str,
    key: Option<&str>,
    is_list: bool,
    value: &mut RewrittenValue,
) {
    let word = masked.trim();
    let is_constant =
        matches!(word.trim_start_matches(['+', '-']), "true" | "false" | "inf" | "nan");
    let new = if word.is_empty() || word.contains('"') || is_constant {
        None
    } else if word.starts_with(char::is_alphabetic) {
        // Without a key the line may be the name of a table.
        key.map(|_| match word.to_lowercase().as_str() {
            "true" | "yes" | "on" => (BOOLEAN, "true".into()),
            "false" | "no" | "off" => (BOOLEAN, "false".into()),
            _ => (WORD, format!("\"{word}\"")),
        })
        .map(|(kind, text)| (vec![kind], text))
    } else {
        number(word, key, is_list, &mut value.has_unknown_unit)
    };
    match new {
        Some((kinds, text)) if !kinds.is_empty() => {
            kinds.into_iter().for_each(|kind| add_kind(value, kind));
            value.text += &masked.replacen(word, &text, 1);
        }
        _ => value.text += original,
    }
}

/// Rewrites a number; `None` if `word` is no number, or an expression.
fn number(
    word: &str,
    key: Option<&str>,
    is_list: bool,
    has_unknown_unit: &mut bool,
) -> Option<(Vec<ValueKind>, String)> {
    let mut kinds = Vec::new();
    let unsigned = word.trim_start_matches(['+', '-']);
    let body = unsigned.trim_start_matches(|c: char| DASHES.contains(c));
    let mut sign = &word[..word.len() - unsigned.len()];
    if body.len() < unsigned.len() {
        kinds.push(MINUS);
        sign = "-";
    }
    let end = body.find(|c: char| !(c.is_ascii_digit() || matches!(c, '.' | ',' | '_')));
    let (mantissa, rest) = body.split_at(end.unwrap_or(body.len()));
    if !mantissa.contains(|c: char| c.is_ascii_digit()) || mantissa.matches(',').count() > 1 {
        return None;
    }
    let mut digits = mantissa.to_string();
    if let Some((whole, decimals)) = mantissa.split_once(',') {
        kinds.push(COMMA);
        digits = format!("{}.{decimals}", whole.replace('.', ""));
    }
    let (whole, decimals) = digits.split_once('.').unwrap_or((&digits, "0"));
    if whole.is_empty() || decimals.is_empty() {
        kinds.push(POINT);
        let zero = |part: &str| if part.is_empty() { "0".to_string() } else { part.to_string() };
        digits = format!("{}.{}", zero(whole), zero(decimals));
    } else if !is_list && whole.len() > 1 && whole.starts_with('0') {
        kinds.push(ZEROS);
        let stripped = whole.trim_start_matches('0');
        let stripped = if stripped.is_empty() { "0" } else { stripped };
        digits = format!("{stripped}{}", &digits[whole.len()..]);
    }
    let length = exponent_length(rest);
    let (exponent, unit) = rest.split_at(length);
    let mut text = format!("{sign}{digits}{exponent}");
    let unit = unit.trim();
    if !unit.is_empty() {
        let is_prefix = digits == "0" && unit.starts_with(['x', 'o', 'b']);
        if is_prefix || !is_unit(unit) {
            return None;
        }
        kinds.push(UNIT);
        match in_unit_of(key, unit, &text) {
            Some(converted) => text = converted,
            None => *has_unknown_unit = true,
        }
    }
    text.parse::<f64>().is_ok_and(f64::is_finite).then_some((kinds, text))
}

/// Returns the length of the exponent at the start of `rest`.
fn exponent_length(rest: &str) -> usize {
    let Some(after) = rest.strip_prefix(['e', 'E']) else { return 0 };
    let digits = after.trim_start_matches(['+', '-']);
    let count = digits.find(|c: char| !c.is_ascii_digit()).unwrap_or(digits.len());
    if count == 0 { 0 } else { rest.len() - digits.len() + count }
}

fn is_unit(text: &str) -> bool {
    text.starts_with(|c: char| c.is_alphabetic() || "%°‰".contains(c))
        && text.chars().all(|c| c.is_alphanumeric() || " /^*·°%‰-_().⁻".contains(c))
}

/// Returns the number in the unit of the key; `None` if the unit is unknown.
fn in_unit_of(key: Option<&str>, unit: &str, number: &str) -> Option<String> {
    let key_unit = KEY_UNITS.iter().find(|u| key.is_some_and(|k| k.ends_with(&format!("_{u}"))))?;
    let key_unit = key_unit.replace("_per_", "/").replace('_', "");
    let unit = unit.replace([' ', '^', '*', '·', '(', ')'], "").replace('²', "2").replace('³', "3");
    let unit = unit.replace('μ', "µ");
    if unit.eq_ignore_ascii_case(&key_unit) {
        return Some(number.into());
    }
    let (.., ratio, divisor) =
        CONVERSIONS.iter().find(|(from, to, ..)| *from == unit && *to == key_unit)?;
    Some(format!("{}", number.parse::<f64>().ok()? * ratio / divisor))
}
