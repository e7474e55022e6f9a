//! Imports go one way: in no package do files import one another in a circle.
//!
//! A node is a file. An edge is every `use`, every re-export and every inline path, outside `#[cfg(test)]`, that names
//! something in another file of the same package. A `mod` line is none: it says where a file is, not what its parent
//! needs.
//!
//! The same holds for test programs, where the tests themselves count, too.
//!
//! `imports/methods.rs` has the calls of methods, where the `impl` of a type is in several files.

#[path = "imports/methods.rs"]
mod methods;

use proc_macro2::{TokenStream, TokenTree};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use syn::{Attribute, Item, UseTree, visit::Visit};

/// A module's place: the idents from the package's root.
type Module = Vec<String>;

/// The modules of one crate, and the file of each.
#[derive(Default)]
struct Crate {
    /// The file of each module.
    files: BTreeMap<Module, PathBuf>,
    /// The source of each file; without its tests, unless they count.
    items: BTreeMap<PathBuf, Vec<(Module, Vec<Item>)>>,
    /// Tests count: the crate is a test program.
    tests_count: bool,
}

impl Crate {
    fn read(root: &Path) -> Self {
        Self::default().with(root)
    }

    fn read_test_program(root: &Path) -> Self {
        Self { tests_count: true, ..Self::default() }.with(root)
    }

    fn with(mut self, root: &Path) -> Self {
        self.file(root, Vec::new(), root.parent().unwrap());
        self
    }

    fn skips(&self, attributes: &[Attribute]) -> bool {
        !self.tests_count && is_test(attributes)
    }

    /// Reads a file, and the files of its modules, which lie in `folder`.
    fn file(&mut self, path: &Path, module: Module, folder: &Path) {
        let text =
            std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let file = syn::parse_file(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        self.module(path, module, folder, file.items);
    }

    fn module(&mut self, path: &Path, module: Module, folder: &Path, items: Vec<Item>) {
        self.files.insert(module.clone(), path.into());
        let mut own = Vec::new();
        for item in items {
            match item {
                Item::Mod(inner) if !self.skips(&inner.attrs) => {
                    let name = inner.ident.to_string();
                    let mut child = module.clone();
                    child.push(name.clone());
                    match inner.content {
                        Some((_, items)) => self.module(path, child, &folder.join(&name), items),
                        None => {
                            let flat = folder.join(format!("{name}.rs"));
                            let deep = folder.join(&name).join("mod.rs");
                            let (place, folder) = match at(&inner.attrs) {
                                // Its modules lie beside it.
                                Some(file) => {
                                    let place = path.parent().unwrap().join(file);
                                    let beside = place.parent().unwrap().to_owned();
                                    (place, beside)
                                }
                                None => (if flat.exists() { flat } else { deep }, folder.join(&name)),
                            };
                            self.file(&place, child, &folder);
                        }
                    }
                }
                Item::Mod(_) => {}
                item if self.skips(attributes(&item)) => {}
                item => own.push(item),
            }
        }
        self.items.entry(path.into()).or_default().push((module, own));
    }

    /// Which files import which.
    fn edges(&self) -> BTreeMap<PathBuf, BTreeSet<PathBuf>> {
        let mut edges: BTreeMap<PathBuf, BTreeSet<PathBuf>> = BTreeMap::new();
        for (file, modules) in &self.items {
            for (module, items) in modules {
                let mut found =
                    Paths { crate_: self, module, names: BTreeMap::new(), targets: BTreeSet::new() };
                // What a `use` brings in is known before any path that begins with it.
                for item in items {
                    if let Item::Use(item) = item {
                        found.tree(&item.tree, &mut Vec::new());
                    }
                }
                for item in items {
                    found.visit_item(item);
                }
                let targets = found.targets.into_iter().filter(|target| target != file);
                edges.entry(file.clone()).or_default().extend(targets);
            }
        }
        edges
    }
}

/// The paths in one module.
struct Paths<'a> {
    crate_: &'a Crate,
    module: &'a Module,
    /// Modules that a `use` has given a name here.
    names: BTreeMap<String, Module>,
    targets: BTreeSet<PathBuf>,
}

impl Paths<'_> {
    /// The module that a path begins with, as far as it names modules.
    fn resolve(&self, path: &[String]) -> Option<Module> {
        let (first, mut rest) = path.split_first()?;
        let mut at = match first.as_str() {
            "crate" => Vec::new(),
            "self" => self.module.clone(),
            "super" => self.module.split_last()?.1.to_vec(),
            name => match self.names.get(name) {
                Some(module) => module.clone(),
                None => {
                    let child = [self.module.as_slice(), &[name.to_string()]].concat();
                    self.crate_.files.contains_key(&child).then_some(child)?
                }
            },
        };
        while let Some((next, more)) = rest.split_first() {
            let deeper = match next.as_str() {
                "super" => at.split_last()?.1.to_vec(),
                name => [at.as_slice(), &[name.to_string()]].concat(),
            };
            if !self.crate_.files.contains_key(&deeper) {
                break;
            }
            (at, rest) = (deeper, more);
        }
        Some(at)
    }

    fn path(&mut self, path: &[String]) {
        if path.len() > 1
            && let Some(module) = self.resolve(path)
            && let Some(file) = self.crate_.files.get(&module)
        {
            self.targets.insert(file.clone());
        }
    }

    fn tree(&mut self, tree: &UseTree, before: &mut Vec<String>) {
        match tree {
            UseTree::Path(path) => {
                before.push(path.ident.to_string());
                self.tree(&path.tree, before);
                before.pop();
            }
            UseTree::Name(name) => self.named(&name.ident.to_string(), &name.ident.to_string(), before),
            UseTree::Rename(name) => self.named(&name.ident.to_string(), &name.rename.to_string(), before),
            UseTree::Glob(_) => {
                before.push("*".into());
                self.path(before);
                before.pop();
            }
            UseTree::Group(group) => {
                for tree in &group.items {
                    self.tree(tree, before);
                }
            }
        }
    }

    fn named(&mut self, name: &str, here: &str, before: &[String]) {
        let mut path = before.to_vec();
        if name != "self" {
            path.push(name.into());
        }
        let here = if name == "self" { path.last().cloned().unwrap_or_default() } else { here.to_string() };
        if let Some(module) = self.resolve(&path) {
            // `use super::codec` names a module; `use super::codec::Frame` something in one.
            if module.last().is_some_and(|last| path.last() == Some(last)) {
                self.names.insert(here, module);
            }
            path.push("*".into());
            self.path(&path);
        }
    }

    /// The paths in what a macro is given, or is made of. `before`: the path of the braces that they stand in; `depth`: how many
    /// modules of the macro.
    fn tokens(&mut self, tokens: TokenStream, before: &[String], depth: usize) {
        let mut path = before.to_vec();
        let (mut colons, mut module) = (0, None);
        for token in tokens {
            match token {
                TokenTree::Ident(ident) => {
                    if colons != 2 {
                        let found = std::mem::replace(&mut path, before.to_vec());
                        module = (found == ["mod"]).then_some(());
                        self.of_macro(&found, depth);
                    }
                    path.push(ident.to_string());
                    colons = 0;
                }
                TokenTree::Punct(punct) if punct.as_char() == ':' => colons += 1,
                TokenTree::Group(group) if colons == 2 => {
                    let before_group = std::mem::replace(&mut path, before.to_vec());
                    self.tokens(group.stream(), &before_group, depth);
                    colons = 0;
                }
                token => {
                    let found = std::mem::replace(&mut path, before.to_vec());
                    self.of_macro(&found, depth);
                    colons = 0;
                    if let TokenTree::Group(group) = token {
                        let inner = usize::from(module.take().is_some());
                        self.tokens(group.stream(), &[], depth + inner);
                    }
                }
            }
        }
        self.of_macro(&path, depth);
    }

    /// A path in a module of a macro: the first `super` of each such module leads to the file itself.
    fn of_macro(&mut self, path: &[String], depth: usize) {
        let up = path.iter().take_while(|ident| *ident == "super").count();
        if depth == 0 || up == 0 {
            self.path(path);
        } else if up > depth {
            self.path(&path[depth..]);
        }
    }
}

impl<'ast> Visit<'ast> for Paths<'_> {
    fn visit_path(&mut self, path: &'ast syn::Path) {
        let idents: Vec<String> = path.segments.iter().map(|segment| segment.ident.to_string()).collect();
        self.path(&idents);
        syn::visit::visit_path(self, path);
    }

    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        self.tree(&item.tree, &mut Vec::new());
    }

    fn visit_macro(&mut self, found: &'ast syn::Macro) {
        self.tokens(found.tokens.clone(), &[], 0);
    }

    fn visit_attribute(&mut self, _: &'ast Attribute) {}

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        if !self.crate_.skips(&item.attrs) {
            syn::visit::visit_item_fn(self, item);
        }
    }
}

fn attributes(item: &Item) -> &[Attribute] {
    match item {
        Item::Const(item) => &item.attrs,
        Item::Enum(item) => &item.attrs,
        Item::Fn(item) => &item.attrs,
        Item::Impl(item) => &item.attrs,
        Item::Macro(item) => &item.attrs,
        Item::Static(item) => &item.attrs,
        Item::Struct(item) => &item.attrs,
        Item::Use(item) => &item.attrs,
        _ => &[],
    }
}

fn is_test(attributes: &[Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        attribute.path().is_ident("test")
            || attribute.path().is_ident("cfg")
                && attribute.parse_args::<syn::Ident>().is_ok_and(|name| name == "test")
    })
}

/// The file that `#[path = "..."]` names.
fn at(attributes: &[Attribute]) -> Option<String> {
    attributes.iter().find(|attribute| attribute.path().is_ident("path")).and_then(|attribute| {
        let value = attribute.meta.require_name_value().ok()?;
        match &value.value {
            syn::Expr::Lit(syn::ExprLit { lit: syn::Lit::Str(text), .. }) => Some(text.value()),
            _ => None,
        }
    })
}

/// The first circle that is found: its files, in the order in which each imports the next.
fn circle(edges: &BTreeMap<PathBuf, BTreeSet<PathBuf>>) -> Option<Vec<PathBuf>> {
    fn walk(
        file: &PathBuf,
        edges: &BTreeMap<PathBuf, BTreeSet<PathBuf>>,
        way: &mut Vec<PathBuf>,
        done: &mut BTreeSet<PathBuf>,
    ) -> Option<Vec<PathBuf>> {
        if let Some(start) = way.iter().position(|before| before == file) {
            return Some(way[start..].to_vec());
        }
        if !done.insert(file.clone()) {
            return None;
        }
        way.push(file.clone());
        let found = edges.get(file).into_iter().flatten().find_map(|next| walk(next, edges, way, done));
        way.pop();
        found
    }
    let mut done = BTreeSet::new();
    edges.keys().find_map(|file| walk(file, edges, &mut Vec::new(), &mut done))
}

/// Fails with the circle, file by file.
fn assert_one_way(root: &Path) {
    let edges = Crate::read(root).edges();
    if let Some(circle) = circle(&edges) {
        let files: Vec<String> = circle.iter().map(|file| file.display().to_string()).collect();
        panic!("{} imports in a circle:\n  {}", root.display(), files.join("\n  imports "));
    }
}

fn root(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(file)
}

/// The roots of every package's test programs: `tests/name.rs` and `tests/name/main.rs`.
fn test_programs() -> Vec<String> {
    let mut found = Vec::new();
    for package in [
        "",
        "jetlink/",
        "toy/",
        "mavlink/",
        "rc/",
        "usb/",
        "boards/",
        "sim/",
        "host/",
        "image/",
        "qemu/",
        "xtask/",
        "emulation/",
    ] {
        let folder = format!("{package}tests");
        for entry in std::fs::read_dir(root(&folder)).into_iter().flatten().flatten() {
            let name = format!("{folder}/{}", entry.file_name().display());
            let main = format!("{name}/main.rs");
            if name.ends_with(".rs") {
                found.push(name);
            } else if root(&main).exists() {
                found.push(main);
            }
        }
    }
    found
}

#[test]
fn circles_are_sought_in_test_programs_too() {
    let found = test_programs();
    for program in [
        "jetlink/tests/it/main.rs",
        "tests/truth/main.rs",
        "tests/wire_zk.rs",
        "emulation/tests/board/main.rs",
    ] {
        assert!(found.iter().any(|name| name == program), "{program}: {found:?}");
    }
}

#[test]
fn no_package_has_a_circle_of_imports() {
    let roots = [
        "jetlink/src/lib.rs",
        "toy/src/lib.rs",
        "mavlink/src/lib.rs",
        "rc/src/lib.rs",
        "usb/src/lib.rs",
        "src/lib.rs",
        "src/main.rs",
        "boards/src/lib.rs",
        "pages/src/lib.rs",
        "sim/src/lib.rs",
        "wired/src/lib.rs",
        "host/src/main.rs",
        "image/src/main.rs",
        "qemu/src/main.rs",
        "xtask/src/main.rs",
        "emulation/src/lib.rs",
    ];
    let packages = roots.map(|file| (String::from(file), Crate::read(&root(file)).edges()));
    let tests = test_programs().into_iter().map(|file| {
        let edges = Crate::read_test_program(&root(&file)).edges();
        (file, edges)
    });
    let found: Vec<String> = packages
        .into_iter()
        .chain(tests)
        .filter_map(|(file, edges)| {
            let circle = circle(&edges)?;
            let files: Vec<String> = circle.iter().map(|file| file.display().to_string()).collect();
            Some(format!("{file}:\n  {}", files.join("\n  imports ")))
        })
        .collect();
    assert!(found.is_empty(), "imports in a circle\n{}", found.join("\n"));
}

#[test]
fn every_kind_of_import_is_seen() {
    let edges = Crate::read(&root("jetlink/src/lib.rs")).edges();
    let imports = |from: &str, to: &str| {
        edges
            .get(&root(&format!("jetlink/src/{from}")))
            .is_some_and(|files| files.contains(&root(&format!("jetlink/src/{to}"))))
    };
    assert!(imports("ecu/zk/link.rs", "ecu/zk/codec/mod.rs"), "use super::");
    assert!(imports("command.rs", "limit.rs"), "use crate::");
    assert!(imports("ecu/mod.rs", "ecu/zk/codec/mod.rs"), "a path without a use");
    assert!(!imports("limit.rs", "command.rs"));
}

#[test]
fn planted_circle_is_found() {
    for (what, a, b) in [
        ("use", "use crate::b::B; pub struct A(B);", "use super::a::A; pub struct B;"),
        ("re-export", "pub use crate::b::B; pub struct A;", "pub struct B; pub fn f(_: crate::a::A) {}"),
        ("inline path", "pub fn f() { crate::b::f() }", "pub fn f() { super::a::f() }"),
        (
            "macro",
            "pub fn f() { assert!(crate::b::f()) }",
            "pub fn f() -> bool { println!(\"{}\", crate::a::X); true }",
        ),
        (
            "group in the body of a macro",
            "macro_rules! m { () => { use super::{b, c}; pub fn f() { b::f() } } }",
            "pub fn f() { super::a::f() }",
        ),
        (
            "group in a module of a macro",
            "macro_rules! m { () => { mod own { use super::super::{b, c}; } } }",
            "macro_rules! m { () => { mod own { pub fn f() { super::super::a::f() } } } }",
        ),
        ("module by name", "use crate::b; pub fn f() { b::f() }", "use crate::a; pub fn f() { a::f() }"),
    ] {
        let folder =
            std::env::temp_dir().join(format!("jetlink-imports-{}-{}", std::process::id(), what.len()));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("lib.rs"), "mod a;\nmod b;\n").unwrap();
        std::fs::write(folder.join("a.rs"), a).unwrap();
        std::fs::write(folder.join("b.rs"), b).unwrap();
        let found = std::panic::catch_unwind(|| assert_one_way(&folder.join("lib.rs")));
        // Without the way back there is none.
        let own = "pub struct B; pub fn f() -> bool { true } macro_rules! m { () => { mod own { use super::a; } } }";
        std::fs::write(folder.join("b.rs"), own).unwrap();
        assert_one_way(&folder.join("lib.rs"));
        std::fs::remove_dir_all(&folder).unwrap();
        assert!(found.is_err(), "{what}");
    }
}

/// A module and the files of its folder may not use each other, nor may tests.
#[test]
fn planted_circle_of_a_test_program_is_found() {
    let folder = std::env::temp_dir().join(format!("jetlink-imports-{}-program", std::process::id()));
    std::fs::create_dir_all(folder.join("a")).unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
    let found = || circle(&Crate::read_test_program(&folder.join("main.rs")).edges());
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

#[test]
fn imports_of_tests_do_not_count() {
    let folder = std::env::temp_dir().join(format!("jetlink-imports-{}-tests", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("lib.rs"), "mod a;\nmod b;\n").unwrap();
    std::fs::write(folder.join("a.rs"), "use crate::b::B; pub struct A(B);").unwrap();
    std::fs::write(folder.join("b.rs"), "pub struct B; #[cfg(test)] mod tests { use crate::a::A; }").unwrap();
    assert_one_way(&folder.join("lib.rs"));
    std::fs::remove_dir_all(&folder).unwrap();
}
