//! Numbers and texts in sentences.

use jetlink::units::{Signed, Verbatim, Whole};

#[test]
fn numbers_and_texts_in_sentences_read_as_core_shows_them() {
    let powers = (0..10).map(|exponent| 10_u32.pow(exponent));
    for number in powers.flat_map(|power| [power - 1, power, power + 1]).chain([123_450, u32::MAX]) {
        assert_eq!(Whole(number).to_string(), number.to_string());
    }
    for number in [i32::MIN, -2731, -10, -1, 0, 1, 9, 10, i32::MAX] {
        assert_eq!(Signed(number).to_string(), number.to_string());
    }
    assert_eq!(Verbatim("left: −4 °C").to_string(), "left: −4 °C");
}
