//! Enumerations with a number on the wire: open ones, whose `Unknown` preserves unnamed numbers, and closed ones.

/// Declares an enumeration of received codes that loses nothing: an unnamed code keeps its number.
macro_rules! open_enum {
    (
        $(#[$meta:meta])*
        pub enum $name:ident {
            $( $(#[$vmeta:meta])* $variant:ident = $code:literal => $text:literal, )+
        }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Copy, PartialEq, Eq, Debug)]
        #[non_exhaustive]
        pub enum $name {
            $( $(#[$vmeta])* $variant, )+
            /// A code that the document does not name, as received.
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
        }

        crate::sentence::sentences!($name {
            $( Self::$variant => $text; )+
        } {
            Self::Unknown(code) => "unknown code {}", crate::units::Whole(code.into());
        });
    };
}

/// Declares a closed enumeration: with codes on the wire (`= 3`), with names (`=> "name"`), or with both.
macro_rules! closed_enum {
    (@enum { $(#[$meta:meta])* } $name:ident { $( { $(#[$vmeta:meta])* } $variant:ident )+ }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, PartialEq, Eq, Debug)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub enum $name {
            $( $(#[$vmeta])* $variant, )+
        }

        impl $name {
            /// All of them.
            pub const ALL: [Self; [$( stringify!($variant) ),+].len()] = [$( Self::$variant ),+];
        }
    };
    (@codes $name:ident { $( $variant:ident = $code:literal )+ }) => {
        impl $name {
            /// From the number on the wire; `None` if it has no meaning.
            pub const fn from_code(code: u8) -> Option<Self> {
                match code {
                    $( $code => Some(Self::$variant), )+
                    _ => None,
                }
            }

            /// The number on the wire.
            pub const fn code(self) -> u8 {
                match self {
                    $( Self::$variant => $code, )+
                }
            }
        }
    };
    (@names $name:ident { $( $variant:ident => $text:literal )+ }) => {
        impl $name {
            /// Name in lower case with hyphens.
            pub const fn name(self) -> &'static str {
                match self {
                    $( Self::$variant => $text, )+
                }
            }
        }
    };
    (
        $(#[$meta:meta])*
        pub enum $name:ident { $( $(#[$vmeta:meta])* $variant:ident = $code:literal, )+ }
    ) => {
        crate::codes::closed_enum!(@enum { $(#[$meta])* } $name { $( { $(#[$vmeta])* } $variant )+ });
        crate::codes::closed_enum!(@codes $name { $( $variant = $code )+ });
    };
    (
        $(#[$meta:meta])*
        pub enum $name:ident { $( $(#[$vmeta:meta])* $variant:ident => $text:literal, )+ }
    ) => {
        crate::codes::closed_enum!(@enum { $(#[$meta])* } $name { $( { $(#[$vmeta])* } $variant )+ });
        crate::codes::closed_enum!(@names $name { $( $variant => $text )+ });
    };
    (
        $(#[$meta:meta])*
        pub enum $name:ident { $( $(#[$vmeta:meta])* $variant:ident = $code:literal => $text:literal, )+ }
    ) => {
        crate::codes::closed_enum!(@enum { $(#[$meta])* } $name { $( { $(#[$vmeta])* } $variant )+ });
        crate::codes::closed_enum!(@codes $name { $( $variant = $code )+ });
        crate::codes::closed_enum!(@names $name { $( $variant => $text )+ });
    };
}

pub(crate) use {closed_enum, open_enum};
