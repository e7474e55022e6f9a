//! Texts for people, written once for `Display` and for `defmt`.

/// Implements `Display` and, with the feature `defmt`, `defmt::Format` with the same sentences: first those without values,
/// then those with. A value needs both traits. `defmt` keeps the texts out of the image.
macro_rules! sentences {
    (@display $self:ident $f:ident {} { $( $pattern:pat => $text:literal $(, $value:expr)+; )+ }) => {
        match *$self {
            $( $pattern => write!($f, $text $(, $value)+), )+
        }
    };
    (
        @display $self:ident $f:ident { $( $plain:pat $(if $guard:expr)? => $sentence:literal; )+ }
        $({ $( $pattern:pat => $text:literal $(, $value:expr)+; )+ })?
    ) => {{
        // One write for all plain sentences takes less flash than one each.
        let sentence = match *$self {
            $( $plain $(if $guard)? => $sentence, )+
            $( $( $pattern => return write!($f, $text $(, $value)+), )+ )?
        };
        $f.write_str(sentence)
    }};
    (@format $self:ident $f:ident {} { $( $pattern:pat => $text:literal $(, $value:expr)+; )+ }) => {
        match *$self {
            $( $pattern => defmt::write!($f, $text $(, $value)+), )+
        }
    };
    (
        @format $self:ident $f:ident { $( $plain:pat $(if $guard:expr)? => $sentence:literal; )+ }
        $({ $( $pattern:pat => $text:literal $(, $value:expr)+; )+ })?
    ) => {
        let sentence = match *$self {
            $( $plain $(if $guard)? => defmt::intern!($sentence), )+
            $( $( $pattern => return defmt::write!($f, $text $(, $value)+), )+ )?
        };
        defmt::write!($f, "{=istr}", sentence)
    };
    (
        $type:ty {
            $( $plain:pat $(if $guard:expr)? => $sentence:literal; )*
        } $({
            $( $pattern:pat => $text:literal $(, $value:expr)+; )+
        })?
    ) => {
        impl core::fmt::Display for $type {
            fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                crate::sentence::sentences!(@display self f { $( $plain $(if $guard)? => $sentence; )* } $({
                    $( $pattern => $text $(, $value)+; )+
                })?)
            }
        }

        #[cfg(feature = "defmt")]
        impl defmt::Format for $type {
            fn format(&self, f: defmt::Formatter<'_>) {
                crate::sentence::sentences!(@format self f { $( $plain $(if $guard)? => $sentence; )* } $({
                    $( $pattern => $text $(, $value)+; )+
                })?);
            }
        }
    };
}

/// Names the variants of an enumeration: `name`, and the same in `Display` and `defmt::Format`.
macro_rules! names {
    ($type:ident, $doc:literal { $( $variant:ident => $name:literal; )+ }) => {
        impl $type {
            #[doc = $doc]
            pub const fn name(self) -> &'static str {
                match self {
                    $( Self::$variant => $name, )+
                }
            }
        }

        crate::sentence::sentences!($type { $( Self::$variant => $name; )+ });
    };
}

pub(crate) use {names, sentences};
