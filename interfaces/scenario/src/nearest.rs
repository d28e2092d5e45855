//! "Did you mean": nearest known word to an unknown one.

/// Returns the candidate nearest to `word` if it is near enough.
pub fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    // Comparing costs the product of the lengths.
    if word.is_empty() || word.len() > 64 {
        return None;
    }
    let folded = fold(word);
    candidates
        .into_iter()
        .filter_map(|c| {
            let candidate = fold(c);
            let whole = strsim::damerau_levenshtein(&folded, &candidate);
            // The most frequent mistake is a key without its unit, or with another unit: `step` for `step_s`.
            let stems = strsim::damerau_levenshtein(stem(&folded), stem(&candidate));
            let distance = whole.min(1 + stems);
            (distance <= 1 + folded.len() / 4).then_some((distance, c))
        })
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, c)| c)
}

/// Returns a hint for an unknown word.
pub fn did_you_mean<'a>(
    word: &str,
    candidates: impl IntoIterator<Item = &'a str>,
) -> Option<String> {
    nearest(word, candidates).map(|c| format!("did you mean `{c}`?"))
}

fn fold(word: &str) -> String {
    word.to_lowercase().replace(['-', ' '], "_")
}

/// Returns the key without its unit.
fn stem(key: &str) -> &str {
    const UNITS: [&str; 9] =
        ["_kg_per_m3", "_m_per_s2", "_m_per_s", "_hz", "_mm", "_ms", "_m", "_s", "_n"];
    UNITS.iter().find_map(|u| key.strip_suffix(u)).unwrap_or(key)
}
