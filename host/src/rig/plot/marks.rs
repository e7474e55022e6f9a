//! Placement of the events' names: in lines of text above the curves, so that no name covers another one or is crossed by
//! the line below a name.

use super::super::chronicle::Happening;
use super::font::width;
use super::scale::Scale;

/// Lines of text for what happened: as many as its names need, within these.
const LANES: (usize, usize) = (1, 8);
/// Between two names in one line of text.
const BETWEEN: f64 = 6.0;
/// Size of a name: the smallest text of a picture.
pub const SMALL: u32 = 13;

/// Something that happened, in the picture: a line downwards, and its name beside the upper end.
#[derive(Clone, Debug)]
pub struct Mark {
    /// Where its line is.
    pub x: f64,
    /// Its name, set off from the line.
    pub text: String,
    /// Its line of text; `None`: there is no room for its name.
    pub lane: Option<usize>,
    /// Its name is at the left of its line.
    pub at_left: bool,
}

impl Mark {
    /// From where to where its name reaches.
    fn span(&self) -> (f64, f64) {
        let wide = width(&self.text, SMALL) + BETWEEN;
        if self.at_left { (self.x - wide, self.x) } else { (self.x, self.x + wide) }
    }

    /// Whether both fit where they are. One without a name is below all names.
    fn goes_with(&self, other: &Self) -> bool {
        let (Some(lane), Some(of_other)) = (self.lane, other.lane) else { return true };
        let (span, span_of_other) = (self.span(), other.span());
        let inside = |x: f64, (left, right): (f64, f64)| x > left && x < right;
        let overlap = lane == of_other && span.0 < span_of_other.1 && span_of_other.0 < span.1;
        // A line goes down from its own line of text.
        let crosses = lane <= of_other && inside(self.x, span_of_other);
        let is_crossed = of_other <= lane && inside(other.x, span);
        !overlap && !crosses && !is_crossed
    }
}

/// All events within the picture.
pub fn marks(happened: &[Happening], time: &Scale, sides: (f64, f64)) -> Vec<Mark> {
    let seen = happened.iter().filter_map(|happening| {
        let x = time.at(happening.t);
        (x >= sides.0 && x <= sides.1).then(|| Mark {
            x,
            text: format!("\u{a0}{}\u{a0}", happening.text),
            lane: None,
            at_left: false,
        })
    });
    let mut marks: Vec<Mark> = seen.collect();
    // Names that fit only at the left come first, from the last one on: each is above the earlier ones.
    let (forced, free): (Vec<usize>, Vec<usize>) =
        (0..marks.len()).partition(|&i| marks.get(i).is_some_and(|mark| mark.span().1 > sides.1));
    for (i, at_right) in
        forced.into_iter().rev().map(|i| (i, false)).chain(free.into_iter().map(|i| (i, true)))
    {
        let places = [at_right.then_some(false), Some(true)].into_iter().flatten();
        let places = places.flat_map(|at_left| (0..LANES.1).map(move |lane| (at_left, lane)));
        let Some(mark) = marks.get(i) else { continue };
        let place = places
            .map(|(at_left, lane)| Mark { lane: Some(lane), at_left, ..mark.clone() })
            .find(|mark| mark.span().0 >= sides.0 && marks.iter().all(|other| mark.goes_with(other)));
        if let (Some(mark), Some(place)) = (marks.get_mut(i), place) {
            *mark = place;
        }
    }
    marks
}

/// The lines of text that this takes.
pub fn lanes(happened: &[Happening], time: &Scale, sides: (f64, f64)) -> usize {
    let last = marks(happened, time, sides).iter().filter_map(|mark| mark.lane).max();
    last.map_or(0, |last| last + 1).max(LANES.0)
}

/// How many lines and areas have no name.
pub fn unnamed(happened: &[Happening], time: &Scale, sides: (f64, f64), areas: usize) -> Option<String> {
    let lines = marks(happened, time, sides).iter().filter(|mark| mark.lane.is_none()).count();
    let count = lines + areas;
    (count > 0).then(|| format!("{count} more marked without a name: no room"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDES: (f64, f64) = (100.0, 1220.0);

    fn of(times: impl Iterator<Item = f64>) -> Vec<Happening> {
        let happened = |t| Happening { t, engine: None, text: "limit: exhaust too hot".to_owned() };
        times.map(happened).collect()
    }

    #[test]
    fn marks_without_room_for_their_names_are_counted() {
        let time = Scale::new(0.0..100.0, SIDES.0..SIDES.1);
        let dense = |count: u32| of((0..count).map(|i| 50.0 + f64::from(i) / 10.0));
        assert_eq!(unnamed(&dense(8), &time, SIDES, 0), None);
        assert_eq!(
            unnamed(&dense(11), &time, SIDES, 1).as_deref(),
            Some("4 more marked without a name: no room")
        );
    }

    #[test]
    fn no_name_covers_another_one_or_is_crossed() {
        let time = Scale::new(0.0..100.0, SIDES.0..SIDES.1);
        for seed in 1..200_u32 {
            let t = |i: u32| f64::from((seed * 7919 + i * i * 131 * seed) % 1000) / 10.0;
            let mut times: Vec<f64> = (0..3 + seed % 12).map(t).collect();
            times.sort_by(f64::total_cmp);
            let marks = marks(&of(times.into_iter()), &time, SIDES);
            for (i, mark) in marks.iter().enumerate() {
                assert!(mark.span().0 >= SIDES.0 || mark.lane.is_none(), "{mark:?}");
                assert!(mark.span().1 <= SIDES.1 || mark.lane.is_none(), "{mark:?}");
                let others = marks.iter().enumerate().filter(|(other, _)| *other != i);
                for (_, other) in others {
                    assert!(mark.goes_with(other), "{mark:?} {other:?}");
                }
            }
        }
        // Two close to the end: the earlier one is below the later one.
        let marks = marks(&of([98.0, 99.0].into_iter()), &time, SIDES);
        assert_eq!(
            marks.iter().map(|mark| (mark.lane, mark.at_left)).collect::<Vec<_>>(),
            [(Some(1), true), (Some(0), true)]
        );
    }
}
