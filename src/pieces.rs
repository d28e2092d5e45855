//! Pieces of a slice that threads fill side by side.

/// Cuts `whole` into pieces of these lengths, one after the other; what they leave over is in none.
pub(crate) fn pieces<T>(
    mut whole: &mut [T],
    lengths: impl Iterator<Item = usize>,
) -> Vec<&mut [T]> {
    lengths.map(|n| whole.split_off_mut(..n).unwrap_or_default()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_follow_each_other_and_are_empty_beyond_the_end() {
        let mut whole = [1, 2, 3, 4];
        let found = pieces(&mut whole, [2, 0, 1, 7].into_iter());
        let expected: [&[i32]; 4] = [&[1, 2], &[], &[3], &[]];
        assert_eq!(found, expected);
    }
}
