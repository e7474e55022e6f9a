//! Planted circles have to be found.

use crate::source::{Crate, root};
use crate::{assert_one_way, circle, edges};
use std::path::Path;

#[test]
fn planted_circle_is_found() {
    const LIB: &str = "mod a; mod b;";
    for (i, (what, lib, a, b)) in [
        ("use", LIB, "use crate::b::B; pub struct A(B);", "use super::a::A; pub struct B;"),
        ("re-export", LIB, "pub use crate::b::B; pub struct A;", "pub struct B; pub fn f(_: crate::a::A) {}"),
        ("inline path", LIB, "pub fn f() { crate::b::f() }", "pub fn f() { super::a::f() }"),
        (
            "macro",
            LIB,
            "pub fn f() { assert!(crate::b::f()) }",
            "pub fn f() -> bool { println!(\"{}\", crate::a::X); true }",
        ),
        (
            "group in the body of a macro",
            LIB,
            "macro_rules! m { () => { use super::{b, c}; pub fn f() { b::f() } } }",
            "pub fn f() { super::a::f() }",
        ),
        (
            "group in a module of a macro",
            LIB,
            "macro_rules! m { () => { mod own { use super::super::{b, c}; } } }",
            "macro_rules! m { () => { mod own { pub fn f() { super::super::a::f() } } } }",
        ),
        ("module by name", LIB, "use crate::b; pub fn f() { b::f() }", "use crate::a; pub fn f() { a::f() }"),
        ("glob", LIB, "use super::*; pub fn f() { b::f() }", "use super::*; pub fn f() { a::f() }"),
        (
            "name of a glob",
            "mod a; mod b; use b as other;",
            "use super::*; pub fn f() { other::f() }",
            "pub fn f() { crate::a::f() }",
        ),
        (
            "glob in a function",
            LIB,
            "pub fn f() { use super::*; b::f() }",
            "pub fn f() { use crate as root; root::a::f() }",
        ),
        (
            "crate by another name",
            LIB,
            "use crate as root; pub fn f() { root::b::f() }",
            "use crate::{self as root}; pub fn f() { root::a::f() }",
        ),
        (
            "crate by another name elsewhere",
            "mod a; mod b; use crate as root;",
            "pub fn f() { super::root::b::f() }",
            "pub fn f() { crate::root::a::f() }",
        ),
        (
            "extern crate self",
            LIB,
            "extern crate self as me; pub fn f() { me::b::f() }",
            "extern crate self as me; pub fn f() { me::a::f() }",
        ),
        (
            "extern crate self for all modules",
            "extern crate self as me; mod a; mod b;",
            "pub fn f() { me::b::f() }",
            "pub fn f() { me::a::f() }",
        ),
        (
            "macro_use",
            "#[macro_use] mod b; mod a;",
            "pub fn f() { m!() }",
            "macro_rules! m { () => {} } pub fn f() { crate::a::f() }",
        ),
        (
            "macro_use in a macro",
            "#[macro_use] mod b; mod a;",
            "pub fn f() { assert!(m!()) }",
            "macro_rules! m { () => { true } } pub fn f() { crate::a::f() }",
        ),
        (
            "macro_export",
            LIB,
            "pub fn f() { crate::m!() }",
            "#[macro_export] macro_rules! m { () => {} } pub fn f() { crate::a::f() }",
        ),
        (
            "macro_export in a macro",
            LIB,
            "macro_rules! own { () => { $crate::m!() } }",
            "#[macro_export] macro_rules! m { () => {} } pub fn f() { crate::a::f() }",
        ),
        (
            "macro_export in a use",
            LIB,
            "use crate::m; pub fn f() { m!() }",
            "#[macro_export] macro_rules! m { () => {} } pub fn f() { crate::a::f() }",
        ),
        (
            "attribute",
            LIB,
            "pub struct A { #[arg(value_parser = crate::b::parse)] a: u8 }",
            "pub fn parse() { super::a::f() }",
        ),
        (
            "text of an attribute",
            LIB,
            "pub struct A { #[serde(with = \"crate::b\")] a: u8 }",
            "#[serde(remote = \"super::a::A\")] pub struct B;",
        ),
        (
            "text of an attribute by name and value",
            LIB,
            "#[with = \"crate::b\"] pub struct A;",
            "#[with = crate::a::A] pub struct B;",
        ),
    ]
    .into_iter()
    .enumerate()
    {
        let folder = std::env::temp_dir().join(format!("jetlink-imports-{}-{i}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("lib.rs"), lib).unwrap();
        std::fs::write(folder.join("a.rs"), a).unwrap();
        std::fs::write(folder.join("b.rs"), b).unwrap();
        let found = circle(&edges(&Crate::read(&folder.join("lib.rs"))));
        // Without the way back there is none.
        let own = "pub struct B; pub fn f() -> bool { true } macro_rules! m { () => { mod own { use super::a; } } }";
        std::fs::write(folder.join("b.rs"), own).unwrap();
        assert_one_way(&folder.join("lib.rs"));
        std::fs::remove_dir_all(&folder).unwrap();
        let [a, b] = ["a.rs", "b.rs"].map(|name| folder.join(name));
        assert_eq!(found, Some(vec![a, b]), "{what}");
    }
}

/// A module and the files of its folder may not use each other, nor may tests.
#[test]
fn planted_circle_of_a_test_program_is_found() {
    let folder = std::env::temp_dir().join(format!("jetlink-imports-{}-program", std::process::id()));
    std::fs::create_dir_all(folder.join("a")).unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
    let found = || circle(&edges(&Crate::read_test_program(&folder.join("main.rs"))));
    write("main.rs", "mod a;\nmod b;\n");
    write("a.rs", "mod c; use c::C; pub struct A(C);");
    write("a/c.rs", "pub struct C;");
    write("b.rs", "use crate::a::A; pub struct B(A);");
    let none = found();
    write("a/c.rs", "use super::A; pub struct C(Option<Box<A>>);");
    let in_a_folder = found();
    write("a/c.rs", "pub struct C; #[test] fn b() { crate::b::f() }");
    let of_a_test = found();
    std::fs::remove_dir_all(&folder).unwrap();
    let [a, b, c] = ["a.rs", "b.rs", "a/c.rs"].map(|name| folder.join(name));
    assert_eq!(none, None);
    assert_eq!(in_a_folder, Some(vec![c.clone(), a.clone()]));
    assert_eq!(of_a_test, Some(vec![c, b, a]));
}

/// `cfg` chooses one of two files: both count.
#[test]
fn planted_circle_in_either_file_of_a_module_is_found() {
    let folder = std::env::temp_dir().join(format!("jetlink-imports-{}-either", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
    write("b.rs", "pub fn f() { crate::a::f() }");
    let (back, none) = ("pub fn f() { crate::b::f() }", "pub fn f() {}");
    for lib in [
        "#[cfg(x)] #[path = \"a.rs\"] mod a; #[cfg(not(x))] #[path = \"c.rs\"] mod a; mod b;",
        "#[cfg_attr(x, path = \"c.rs\")] mod a; mod b;",
        "#[cfg_attr(x, path = \"a.rs\")] #[cfg_attr(not(x), path = \"c.rs\")] mod a; mod b;",
    ] {
        write("lib.rs", lib);
        let found = |a: &str, c: &str| {
            write("a.rs", a);
            write("c.rs", c);
            circle(&edges(&Crate::read(&folder.join("lib.rs"))))
        };
        let [a, b, c] = ["a.rs", "b.rs", "c.rs"].map(|name| folder.join(name));
        assert_eq!(found(back, none), Some(vec![a, b.clone()]), "{lib}");
        assert_eq!(found(none, back), Some(vec![b, c]), "{lib}");
        assert_eq!(found(none, none), None, "{lib}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn include_is_refused_unless_the_file_is_generated() {
    let folder = std::env::temp_dir().join(format!("jetlink-imports-{}-include", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let is_refused = |text: &str| {
        std::fs::write(folder.join("lib.rs"), text).unwrap();
        std::panic::catch_unwind(|| Crate::read(&folder.join("lib.rs"))).is_err()
    };
    for (text, refused) in [
        ("include!(\"a.rs\");", true),
        ("const A: u8 = include!(\"a.rs\");", true),
        ("fn f() { assert!(core::include!(\"a.rs\")) }", true),
        ("macro_rules! m { () => { include!(\"a.rs\"); } }", true),
        ("include!(concat!(env!(\"OUT_DIR\"), \"/a.rs\"));", false),
        ("const A: &str = include_str!(\"a.txt\");", false),
    ] {
        assert_eq!(is_refused(text), refused, "{text}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn imports_of_tests_do_not_count() {
    let folder = std::env::temp_dir().join(format!("jetlink-imports-{}-tests", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
    write("lib.rs", "mod a;\nmod b;\n");
    write("a.rs", "use crate::b::B; pub struct A(B); impl B { fn a(&self) {} }");
    for of_tests in [
        "mod tests { use crate::a::A; }",
        "use crate::a::A;",
        "type A = crate::a::A;",
        "trait T: crate::a::A {}",
        "union U { a: crate::a::A }",
        "extern \"C\" { fn f(a: crate::a::A); }",
        "fn f() { B::a() }",
    ] {
        let all = |cfg: &str| {
            write("b.rs", &format!("pub struct B; {cfg} {of_tests}"));
            circle(&edges(&Crate::read(&folder.join("lib.rs"))))
        };
        assert!(all("").is_some(), "{of_tests}");
        assert_eq!(all("#[cfg(test)]"), None, "{of_tests}");
        assert_eq!(all("#[cfg(all(feature = \"x\", test))]"), None, "{of_tests}");
        assert_eq!(all("#[cfg(any(test, all(test, unix)))]"), None, "{of_tests}");
        assert!(all("#[cfg(any(test, unix))]").is_some(), "{of_tests}");
        assert!(all("#[cfg(not(test))]").is_some(), "{of_tests}");
    }
    for of_tests in ["fn f(&self) { crate::a::f(); self.a() }", "const C: crate::a::A = crate::a::C;"] {
        for item in ["impl B", "trait T"] {
            let all = |cfg: &str| {
                write("b.rs", &format!("pub struct B; {item} {{ {cfg} {of_tests} }}"));
                circle(&edges(&Crate::read(&folder.join("lib.rs"))))
            };
            assert!(all("").is_some(), "{item}: {of_tests}");
            assert_eq!(all("#[cfg(test)]"), None, "{item}: {of_tests}");
        }
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn planted_circle_of_methods_is_found() {
    let folder = std::env::temp_dir().join(format!("jetlink-methods-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
    let found = |lib: &Path| circle(&edges(&Crate::read(lib)));
    write("lib.rs", "mod a;\nmod b;\nmod c;\nmod d;\n");
    write("c.rs", "pub struct E; pub struct F; pub struct G<'a> { pub e: &'a E }");
    // Another type of the same name.
    write("d.rs", "pub struct E; impl E { fn a(&self) { self.b() } fn b(&self) {} }");
    let of_e = |method: &str| format!("use crate::c::E; impl E {{ {method} }}");
    for (what, a, b) in [
        ("method", of_e("fn a(&self) { self.b() }"), of_e("fn b(&self) { self.a() }")),
        ("macro", of_e("fn a(&self) { assert!(self.b()) }"), of_e("fn b(&self) { self.a() }")),
        ("path", of_e("fn a(&self) { Self::b() }"), of_e("fn b() { E::a() }")),
        (
            "path in a macro",
            of_e("fn a(&self) { dbg!(crate::c::E::b()) }"),
            of_e("fn b() { dbg!(Self::a()) }"),
        ),
        ("reference", of_e("fn a(&self) { (&*self).b() }"), of_e("fn b(&self) { (*self).a() }")),
        ("path of a type", of_e("fn a(&self) { <Self>::b() }"), of_e("fn b() { <crate::c::E>::a() }")),
        ("constant", of_e("const A: u8 = Self::B;"), of_e("const B: u8 = 0; fn b() -> u8 { Self::A }")),
        ("function", of_e("fn a(&self) { self.b() }"), of_e("fn b() {}") + "fn f(e: &E) { E::a(e) }"),
        (
            "method of a trait",
            of_e("fn a(&self) { self.b() }"),
            of_e("fn b(&self) {}") + "impl Drop for E { fn drop(&mut self) { self.a() } }",
        ),
        (
            "method of a field",
            of_e("fn a(&self) { self.b() }"),
            of_e("fn b(&self) {}") + "impl crate::c::G<'_> { fn g(&self) { self.e.a() } }",
        ),
        (
            "type by another name",
            "use crate::c::E as G; impl G { fn a(&self) { self.b() } }".into(),
            "use crate::c::*; type G = E; impl G { fn b(&self) { self.a() } }".into(),
        ),
        ("an import back", of_e("fn a(&self) { self.b() }"), of_e("fn b() { crate::a::x() }")),
    ] {
        write("a.rs", &a);
        write("b.rs", &b);
        let circle = found(&folder.join("lib.rs"));
        // Another type's method of this name is none of the type.
        let other = of_e("const B: u8 = 0; fn b(&self, o: &O) { o.a(); self.o.a(); crate::d::E::a(o) }");
        write("b.rs", &(other + "impl crate::c::F { fn a(&self) { self.a() } }"));
        let none = found(&folder.join("lib.rs"));
        assert_eq!((circle.map(|files| files.len()), none), (Some(2), None), "{what}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Imports do not show this circle of the library: `runner.rs` makes a runner of a channel.
#[test]
fn call_of_the_runner_in_the_channel_is_found() {
    let folder = std::env::temp_dir().join(format!("jetlink-runner-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
    let source = |name: &str| std::fs::read_to_string(root("jetlink/src").join(name)).unwrap();
    let found = || circle(&edges(&Crate::read(&folder.join("lib.rs"))));
    write("lib.rs", "mod channel;\nmod runner;\n");
    write("runner.rs", &source("runner.rs"));
    write("channel.rs", &source("channel.rs"));
    let none = found();
    let planted = "impl Channel { fn planted(&self) { self.runner(); } }";
    write("channel.rs", &(source("channel.rs") + planted));
    let planted = found();
    std::fs::remove_dir_all(&folder).unwrap();
    let [channel, runner] = ["channel.rs", "runner.rs"].map(|name| folder.join(name));
    assert_eq!((none, planted), (None, Some(vec![channel, runner])));
}
