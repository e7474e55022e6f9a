//! Enumerations received over a wire: named values, and `Unknown` that keeps the number of all others.

/// Declares an enumeration of received codes that loses nothing: a code without a name keeps its number.
macro_rules! open_enum {
    (
        $(#[$meta:meta])*
        pub enum $name:ident {
            $( $(#[$vmeta:meta])* $variant:ident = $code:literal => $text:literal, )+
        }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Copy, PartialEq, Eq, Debug)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub enum $name {
            $( $(#[$vmeta])* $variant, )+
            /// A code the document does not name, kept as it came.
            Unknown(u8),
        }

        impl $name {
            /// From the number on the wire. Every number has a value.
            pub const fn from_code(code: u8) -> Self {
                match code {
                    $( $code => Self::$variant, )+
                    other => Self::Unknown(other),
                }
            }

            /// The number on the wire.
            pub const fn code(self) -> u8 {
                match self {
                    $( Self::$variant => $code, )+
                    Self::Unknown(code) => code,
                }
            }

            /// Name in lower case with hyphens; `"unknown"` for an unnamed number.
            pub const fn name(self) -> &'static str {
                match self {
                    $( Self::$variant => $text, )+
                    Self::Unknown(_) => "unknown",
                }
            }

            /// The same, kept out of the image.
            #[cfg(feature = "defmt")]
            #[allow(dead_code, reason = "not every enumeration is logged by name")]
            pub(crate) fn interned(self) -> defmt::Str {
                match self {
                    $( Self::$variant => defmt::intern!($text), )+
                    Self::Unknown(_) => defmt::intern!("unknown"),
                }
            }
        }
    };
}

pub(crate) use open_enum;
