//! The table of engines in the image is valid. It is also checked at compile time.

use jetlink::config::validate;
use jetlink_fw::config::ENGINES;

#[test]
fn the_table_of_this_aircraft_is_valid() {
    assert_eq!(validate(&ENGINES), Ok(()));
}
