//! Times and shares on the command line: `30s`, `3ms`, `2m`, `0.02`.

use embassy_time::Duration;

/// A length of time: a number with the unit `ms`, `s`, `m` or `h`; a number alone means seconds.
pub fn duration(text: &str) -> Result<Duration, String> {
    let wrong = || format!("invalid duration `{text}`, use for example 300s, 1.5s, 3ms, 2m or 6h");
    let (number, micros_per_unit) = if let Some(number) = text.strip_suffix("ms") {
        (number, 1e3)
    } else if let Some(number) = text.strip_suffix('s') {
        (number, 1e6)
    } else if let Some(number) = text.strip_suffix('m') {
        (number, 60e6)
    } else if let Some(number) = text.strip_suffix('h') {
        (number, 3600e6)
    } else {
        (text, 1e6)
    };
    let number: f64 = number.parse().map_err(|_| wrong())?;
    let micros = number * micros_per_unit;
    // Thirty days are more than any bench run, and far from where numbers overflow.
    if !(0.0..=30.0 * 86_400e6).contains(&micros) {
        return Err(wrong());
    }
    Ok(Duration::from_micros(micros.round() as u64))
}

/// One in a million.
const SMALLEST_SHARE: f64 = 0.000_001;

/// A chance from 0 to 1, in millionths.
pub fn share(text: &str) -> Result<u32, String> {
    match text.parse::<f64>() {
        Ok(share) if share > 0.0 && share < SMALLEST_SHARE => {
            Err(format!("the share {text} is below the smallest one, {SMALLEST_SHARE}"))
        }
        Ok(share) if (0.0..=1.0).contains(&share) => Ok((share * 1e6).round() as u32),
        _ => Err(format!("invalid share `{text}`, use a number from 0 to 1")),
    }
}

/// Seconds for people: `12.3`.
pub fn seconds(time: Duration) -> f64 {
    time.as_micros() as f64 / 1e6
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_units() {
        for (text, micros) in [
            ("90s", 90_000_000),
            ("1.5s", 1_500_000),
            ("3ms", 3000),
            ("2m", 120_000_000),
            ("7", 7_000_000),
            ("1h", 3_600_000_000),
        ] {
            assert_eq!(duration(text), Ok(Duration::from_micros(micros)), "{text}");
        }
        for text in ["", "s", "-1s", "1d", "nan", "inf", "1e99s"] {
            assert!(duration(text).is_err(), "{text}");
        }
    }

    #[test]
    fn shares_are_from_0_to_1() {
        assert_eq!(share("0.02"), Ok(20_000));
        assert_eq!(share("1"), Ok(1_000_000));
        assert_eq!((share("0"), share("0.000001")), (Ok(0), Ok(1)));
        for text in ["", "1.1", "-0.1", "2%", "nan", "0.0000009", "1e-9"] {
            assert!(share(text).is_err(), "{text}");
        }
    }
}
