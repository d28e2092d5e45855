//! Rust source with comments, literals and test modules blanked out, line by line in place.

/// Replaces comments, strings and character literals by spaces; keeps line breaks.
pub fn without_comments_and_literals(source: &str) -> String {
    blanked(source, false)
}

/// Replaces all but comments, strings and character literals by spaces; keeps line breaks.
pub fn comments_and_literals(source: &str) -> String {
    blanked(source, true)
}

/// Blanks comments and literals, or all the rest.
///
/// The missing closing quote distinguishes a lifetime from a character literal.
fn blanked(source: &str, keeps_comments: bool) -> String {
    let chars: Vec<char> = source.chars().collect();
    let blank = |c: char, keeps: bool| if keeps || c == '\n' { c } else { ' ' };
    let mut out = String::with_capacity(source.len());
    let mut i = 0;
    while i < chars.len() {
        let end = match chars[i] {
            '/' if chars.get(i + 1) == Some(&'/') => find(&chars, i, |c| c == '\n'),
            '/' if chars.get(i + 1) == Some(&'*') => end_of_block_comment(&chars, i),
            '"' => end_of_string(&chars, i),
            'r' if starts_raw_string(&chars, i) => end_of_raw_string(&chars, i),
            '\'' if chars.get(i + 1) == Some(&'\\') => find(&chars, i + 3, |c| c == '\'') + 1,
            '\'' if chars.get(i + 2) == Some(&'\'') => i + 3,
            _ => {
                out.push(blank(chars[i], !keeps_comments));
                i += 1;
                continue;
            }
        };
        let end = end.min(chars.len());
        out.extend(chars[i..end].iter().map(|&c| blank(c, keeps_comments)));
        i = end;
    }
    out
}

fn find(chars: &[char], from: usize, stop: impl Fn(char) -> bool) -> usize {
    (from..chars.len()).find(|&k| stop(chars[k])).unwrap_or(chars.len())
}

fn end_of_block_comment(chars: &[char], start: usize) -> usize {
    let (mut depth, mut i) = (0, start);
    while i < chars.len() {
        match (chars[i], chars.get(i + 1)) {
            ('/', Some('*')) => (depth, i) = (depth + 1, i + 2),
            ('*', Some('/')) => (depth, i) = (depth - 1, i + 2),
            _ => i += 1,
        }
        if depth == 0 {
            break;
        }
    }
    i
}

fn end_of_string(chars: &[char], start: usize) -> usize {
    let mut i = start + 1;
    while i < chars.len() && chars[i] != '"' {
        i += if chars[i] == '\\' { 2 } else { 1 };
    }
    i + 1
}

fn starts_raw_string(chars: &[char], start: usize) -> bool {
    let before = start.checked_sub(1).map(|k| chars[k]);
    let in_word = before.is_some_and(|c| c != 'b' && (c.is_alphanumeric() || c == '_'));
    !in_word && chars.get(find(chars, start + 1, |c| c != '#')) == Some(&'"')
}

fn end_of_raw_string(chars: &[char], start: usize) -> usize {
    let quote = find(chars, start + 1, |c| c != '#');
    let hashes = quote - start - 1;
    let mut i = quote + 1;
    while i < chars.len() {
        let closing = chars[i + 1..].iter().take(hashes).filter(|&&c| c == '#').count();
        if chars[i] == '"' && closing == hashes {
            return i + 1 + hashes;
        }
        i += 1;
    }
    i
}

/// Blanks every item behind `#[cfg(test)]`; expects text without comments and literals.
pub fn without_tests(text: &str) -> String {
    const MARK: &str = "#[cfg(test)]";
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find(MARK) {
        out.push_str(&rest[..at]);
        let end = at + end_of_item(&rest[at..]);
        out.extend(rest[at..end].chars().map(|c| if c == '\n' { '\n' } else { ' ' }));
        rest = &rest[end..];
    }
    out + rest
}

/// Length up to the item's closing brace, or its semicolon when that comes first.
fn end_of_item(text: &str) -> usize {
    let mut depth = 0;
    for (at, c) in text.char_indices() {
        match c {
            ';' if depth == 0 => return at + 1,
            '{' => depth += 1,
            '}' if depth == 1 => return at + 1,
            '}' => depth -= 1,
            _ => {}
        }
    }
    text.len()
}

/// Numbers of the lines, from 1, that contain `word` as a whole word. Ends that are not part of a name need no
/// boundary, so `unwrap()` and `println!` work as they are.
pub fn lines_with_word(text: &str, word: &str) -> Vec<usize> {
    let named = |c: char| c.is_alphanumeric() || c == '_';
    let stands_alone = |line: &str, at: usize| {
        let before = line[..at].chars().next_back().is_some_and(named);
        let after = line[at + word.len()..].chars().next().is_some_and(named);
        let bound_before = before && word.starts_with(named);
        let bound_after = after && word.ends_with(named);
        !bound_before && !bound_after
    };
    text.lines()
        .enumerate()
        .filter(|(_, line)| line.match_indices(word).any(|(at, _)| stands_alone(line, at)))
        .map(|(k, _)| k + 1)
        .collect()
}

#[test]
fn comments_and_literals_vanish_and_code_stays() {
    let source =
        "a // unsafe\n/* x /* y */ unsafe */ b \"un\\\"safe\" 'u' '\\'' r#\"un\"safe\"# &'a c";
    let text = without_comments_and_literals(source);
    let left: Vec<&str> = text.split_whitespace().collect();
    assert_eq!(left, ["a", "b", "&'a", "c"]);
    assert_eq!(text.lines().count(), 2);
}

#[test]
fn only_items_behind_the_test_mark_vanish() {
    let text =
        "fn a() {}\n#[cfg(test)]\nmod tests { fn b() {} }\nfn c() {}\n#[cfg(test)] mod d;\ne";
    let left = without_tests(text);
    for (word, kept) in [("a", true), ("b", false), ("c", true), ("d", false), ("e", true)] {
        assert_eq!(!lines_with_word(&left, word).is_empty(), kept, "{word}");
    }
    assert_eq!(lines_with_word(&left, "c"), [4]);
}

#[test]
fn words_are_whole_words() {
    assert_eq!(lines_with_word("unsafe_code\nunsafe {", "unsafe"), [2]);
    assert_eq!(lines_with_word("eprintln!()\nprintln!()", "println!"), [2]);
    assert_eq!(lines_with_word("x.unwrap()\nx.unwrap_or(1)", ".unwrap()"), [1]);
}
