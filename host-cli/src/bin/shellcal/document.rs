//! Documents in JSON. Their fields are listed only once: where they are filled in.

/// Builds a value that is written as a JSON object with these fields, in order. `name?: value` takes an `Option`
/// and omits the field if it is `None`; `..name: value` inserts the fields of another document; `name` alone is
/// filled with the variable of that name, and `of.{a, b}` is short for the fields `a: of.a, b: of.b`.
macro_rules! document {
    ($($fields:tt)+) => { document_of!([] [] [] $($fields)+) };
}

/// Moves one field after the other into the type parameters, fields and values of an anonymous type.
macro_rules! document_of {
    ([$($name:ident)+] [$($field:tt)+] [$($value:tt)+]) => {{
        #[expect(non_camel_case_types, reason = "the type of each field has its name")]
        mod document {
            #[derive(serde::Serialize)]
            pub(super) struct Document<$($name),+> { $($field)+ }
        }
        document::Document { $($value)+ }
    }};
    ([$($n:tt)*] [$($f:tt)*] [$($v:tt)*] ..$name:ident: $value:expr $(, $($rest:tt)*)?) => {
        document_of!(
            [$($n)* $name] [$($f)* #[serde(flatten)] pub(super) $name: $name,] [$($v)* $name: $value,] $($($rest)*)?
        )
    };
    ([$($n:tt)*] [$($f:tt)*] [$($v:tt)*] $name:ident?: $value:expr $(, $($rest:tt)*)?) => {
        document_of!(
            [$($n)* $name]
            [$($f)* #[serde(skip_serializing_if = "Option::is_none")] pub(super) $name: Option<$name>,]
            [$($v)* $name: $value,]
            $($($rest)*)?
        )
    };
    ([$($n:tt)*] [$($f:tt)*] [$($v:tt)*] $name:ident: $value:expr $(, $($rest:tt)*)?) => {
        document_of!(
            [$($n)* $name] [$($f)* pub(super) $name: $name,] [$($v)* $name: $value,] $($($rest)*)?
        )
    };
    ([$($n:tt)*] [$($f:tt)*] [$($v:tt)*] $name:ident $(, $($rest:tt)*)?) => {
        document_of!([$($n)*] [$($f)*] [$($v)*] $name: $name $(, $($rest)*)?)
    };
    ([$($n:tt)*] [$($f:tt)*] [$($v:tt)*] $of:ident.{ $($name:ident),+ } $(, $($rest:tt)*)?) => {
        document_of!([$($n)*] [$($f)*] [$($v)*] $($name: $of.$name),+ $(, $($rest)*)?)
    };
}
