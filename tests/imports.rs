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
    /// Names that a module has for other modules, beside its own children.
    names: BTreeMap<Module, BTreeMap<String, Module>>,
    /// Its macros by example.
    macros: Vec<Macro>,
    /// Modules with `#[macro_use]`: their macros belong to the parent, too.
    macro_use: BTreeSet<Module>,
    /// Tests count: the crate is a test program.
    tests_count: bool,
}

/// A `macro_rules!`.
struct Macro {
    name: String,
    module: Module,
    /// By `#[macro_export]` it is one of the crate's root.
    exported: bool,
}

/// What a path leads to.
struct Resolved {
    module: Module,
    /// Modules whose `use` it goes through.
    through: Vec<Module>,
    /// Number of its idents that are not modules.
    rest: usize,
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
        self.find_names();
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
                    let child = child(&module, &name);
                    if has(&inner.attrs, "macro_use") {
                        self.macro_use.insert(child.clone());
                    }
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
                item => {
                    if let Item::Macro(syn::ItemMacro { attrs, ident: Some(name), .. }) = &item {
                        let (name, exported) = (name.to_string(), has(attrs, "macro_export"));
                        self.macros.push(Macro { name, module: module.clone(), exported });
                    }
                    own.push(item);
                }
            }
        }
        self.items.entry(path.into()).or_default().push((module, own));
    }

    /// What each `use` names, until no more is found: one may begin with the name that another one gives.
    fn find_names(&mut self) {
        let uses_of = |(module, items): &(Module, Vec<Item>)| {
            let mut found = Uses::default();
            items.iter().for_each(|item| found.visit_item(item));
            (module.clone(), found)
        };
        let uses: Vec<(Module, Uses)> = self.items.values().flatten().map(uses_of).collect();
        loop {
            let before = self.names.clone();
            for (module, uses) in &uses {
                let mut found = before.get(module).cloned().unwrap_or_default();
                for (name, path) in &uses.named {
                    if let Some(of) = self.resolve(module, path).filter(|resolved| resolved.rest == 0) {
                        found.insert(name.clone(), of.module);
                    }
                }
                // A glob gives way to every other name.
                for path in &uses.globs {
                    let Some(of) = self.resolve(module, path).filter(|resolved| resolved.rest == 0) else {
                        continue;
                    };
                    let names = before.get(&of.module).cloned().unwrap_or_default();
                    for (name, target) in self.children(&of.module).chain(names) {
                        if !self.files.contains_key(&child(module, &name)) {
                            found.entry(name).or_insert(target);
                        }
                    }
                }
                self.names.insert(module.clone(), found);
            }
            if self.names == before {
                return;
            }
        }
    }

    fn children(&self, of: &Module) -> impl Iterator<Item = (String, Module)> {
        let all = self.files.keys().filter(move |module| module.split_last().is_some_and(|(_, up)| up == of));
        all.filter_map(|module| Some((module.last()?.clone(), module.clone())))
    }

    /// A name in a module: a `use`, a child, or one of the whole crate by `extern crate self as`.
    fn name(&self, module: &Module, name: &str) -> Option<Module> {
        let named = |module: &Module| self.names.get(module)?.get(name).cloned();
        let own = child(module, name);
        named(module).or_else(|| self.files.contains_key(&own).then_some(own))
    }

    /// The module that a path in a module begins with, as far as it names modules.
    fn resolve(&self, module: &Module, path: &[String]) -> Option<Resolved> {
        let (first, mut rest) = path.split_first()?;
        let mut through = Vec::new();
        let mut at = match first.as_str() {
            "crate" => Module::new(),
            "self" => module.clone(),
            "super" => module.split_last()?.1.to_vec(),
            name => self.name(module, name).or_else(|| self.of_all(name))?,
        };
        while let Some((next, more)) = rest.split_first() {
            let deeper = match next.as_str() {
                "super" => at.split_last()?.1.to_vec(),
                name => match self.name(&at, name) {
                    Some(deeper) => deeper,
                    None => break,
                },
            };
            if next != "super" && deeper != child(&at, next) {
                through.push(at);
            }
            (at, rest) = (deeper, more);
        }
        Some(Resolved { module: at, through, rest: rest.len() })
    }

    /// The crate by a name of its own: `extern crate self as` in its root gives it to all modules.
    fn of_all(&self, name: &str) -> Option<Module> {
        let root = self.names.get(&Module::new())?;
        root.get(name).filter(|module| module.is_empty()).cloned()
    }

    /// The modules with the macro that `name!` may be in this module, if it is none of the same file and no `use` brings it.
    fn macros_in_scope(&self, module: &Module, name: &str) -> Vec<&Module> {
        let file = &self.files[module];
        let named = self.macros.iter().filter(|found| found.name == name);
        let places: Vec<&Module> = named.map(|found| &found.module).collect();
        if places.iter().any(|place| self.files[*place] == *file) {
            return Vec::new();
        }
        let in_scope = |place: &&Module| {
            let mut at = place.as_slice();
            while self.macro_use.contains(at) {
                at = &at[..at.len() - 1];
            }
            module.starts_with(at)
        };
        places.into_iter().filter(in_scope).collect()
    }

    /// Which files import which.
    fn edges(&self) -> BTreeMap<PathBuf, BTreeSet<PathBuf>> {
        let mut edges: BTreeMap<PathBuf, BTreeSet<PathBuf>> = BTreeMap::new();
        for (file, modules) in &self.items {
            for (module, items) in modules {
                let mut found = Paths { crate_: self, module, targets: BTreeSet::new() };
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

/// A child of a module.
fn child(module: &Module, name: &str) -> Module {
    [module.as_slice(), &[name.to_string()]].concat()
}

/// What the `use` lines of a module name, also those in its functions.
#[derive(Default)]
struct Uses {
    /// By their names here.
    named: Vec<(String, Vec<String>)>,
    globs: Vec<Vec<String>>,
}

impl Uses {
    fn tree(&mut self, tree: &UseTree, before: &mut Vec<String>) {
        match tree {
            UseTree::Path(path) => {
                before.push(path.ident.to_string());
                self.tree(&path.tree, before);
                before.pop();
            }
            UseTree::Name(name) => self.name(&name.ident.to_string(), &name.ident.to_string(), before),
            UseTree::Rename(name) => self.name(&name.ident.to_string(), &name.rename.to_string(), before),
            UseTree::Glob(_) => self.globs.push(before.clone()),
            UseTree::Group(group) => group.items.iter().for_each(|tree| self.tree(tree, before)),
        }
    }

    fn name(&mut self, name: &str, here: &str, before: &[String]) {
        let mut path = before.to_vec();
        if name != "self" {
            path.push(name.into());
        }
        let here = if here == "self" { path.last().cloned().unwrap_or_default() } else { here.into() };
        self.named.push((here, path));
    }
}

impl<'ast> Visit<'ast> for Uses {
    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        self.tree(&item.tree, &mut Vec::new());
    }

    fn visit_item_extern_crate(&mut self, item: &'ast syn::ItemExternCrate) {
        if let Some((_, name)) = item.rename.as_ref().filter(|_| item.ident == "self") {
            self.named.push((name.to_string(), vec!["crate".into()]));
        }
    }
}

/// The paths in one module.
struct Paths<'a> {
    crate_: &'a Crate,
    module: &'a Module,
    targets: BTreeSet<PathBuf>,
}

impl Paths<'_> {
    fn target(&mut self, module: &Module) {
        self.targets.insert(self.crate_.files[module].clone());
    }

    /// A path of at least two idents, or one that is imported.
    fn path(&mut self, path: &[String]) {
        let Some(resolved) = self.crate_.resolve(self.module, path) else { return };
        for module in &resolved.through {
            self.target(module);
        }
        let next = path.len() - resolved.rest;
        let exported = path
            .get(next)
            .filter(|_| resolved.module.is_empty())
            .and_then(|name| self.crate_.macros.iter().find(|found| found.exported && found.name == *name));
        self.target(exported.map_or(&resolved.module, |found| &found.module));
    }

    fn inline(&mut self, path: &[String]) {
        if path.len() > 1 {
            self.path(path);
        }
    }

    /// The macro that is called by this path.
    fn call(&mut self, path: &[String]) {
        match path {
            [name] => {
                for module in self.crate_.macros_in_scope(self.module, name) {
                    self.target(module);
                }
            }
            path => self.inline(path),
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
                        self.of_macro(&found, depth, Self::inline);
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
                    let calls = matches!(&token, TokenTree::Punct(punct) if punct.as_char() == '!');
                    self.of_macro(&found, depth, if calls { Self::call } else { Self::inline });
                    colons = 0;
                    if let TokenTree::Group(group) = token {
                        let inner = usize::from(module.take().is_some());
                        self.tokens(group.stream(), &[], depth + inner);
                    }
                }
            }
        }
        self.of_macro(&path, depth, Self::inline);
    }

    /// A path in a module of a macro: the first `super` of each such module leads to the file itself.
    fn of_macro(&mut self, path: &[String], depth: usize, found: fn(&mut Self, &[String])) {
        let up = path.iter().take_while(|ident| *ident == "super").count();
        if depth == 0 || up == 0 {
            found(self, path);
        } else if up > depth {
            found(self, &path[depth..]);
        }
    }
}

fn idents(path: &syn::Path) -> Vec<String> {
    path.segments.iter().map(|segment| segment.ident.to_string()).collect()
}

impl<'ast> Visit<'ast> for Paths<'_> {
    fn visit_path(&mut self, path: &'ast syn::Path) {
        self.inline(&idents(path));
        syn::visit::visit_path(self, path);
    }

    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        let mut uses = Uses::default();
        uses.tree(&item.tree, &mut Vec::new());
        for path in uses.named.iter().map(|(_, path)| path).chain(&uses.globs) {
            self.path(path);
        }
    }

    fn visit_macro(&mut self, found: &'ast syn::Macro) {
        self.call(&idents(&found.path));
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

fn has(attributes: &[Attribute], name: &str) -> bool {
    attributes.iter().any(|attribute| attribute.path().is_ident(name))
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

/// The folder of every package, with a slash behind it; that of the root is empty. Members of the workspace, and those that it excludes.
fn packages() -> Vec<String> {
    let manifest = std::fs::read_to_string(root("Cargo.toml")).unwrap();
    let list = |key: &str| -> Vec<String> {
        let line = manifest.lines().find_map(|line| line.strip_prefix(key)).expect("a list in one line");
        line.split('"').skip(1).step_by(2).map(str::to_owned).collect()
    };
    let mut found = vec![String::new()];
    for folder in list("members = ").into_iter().chain(list("exclude = ")) {
        let below = names(&folder).into_iter().map(|name| format!("{folder}/{name}"));
        let all = std::iter::once(folder.clone()).chain(below);
        found
            .extend(all.filter(|folder| root(folder).join("Cargo.toml").exists()).map(|folder| folder + "/"));
    }
    found
}

/// The names in a folder, none if there is no such folder.
fn names(folder: &str) -> Vec<String> {
    let entries = std::fs::read_dir(root(folder)).into_iter().flatten().flatten();
    entries.map(|entry| entry.file_name().display().to_string()).collect()
}

/// The roots of the programs in a folder: `name.rs` and `name/main.rs`.
fn programs(folder: &str) -> Vec<String> {
    let all = names(folder).into_iter().map(|name| format!("{folder}/{name}"));
    let roots = all.map(|name| if name.ends_with(".rs") { name } else { name + "/main.rs" });
    roots.filter(|name| root(name).exists()).collect()
}

/// The roots of every package's libraries and programs.
fn crates() -> Vec<String> {
    let mut found = Vec::new();
    for package in packages() {
        let single = ["src/lib.rs", "src/main.rs", "build.rs"].map(|name| format!("{package}{name}"));
        found.extend(single.into_iter().filter(|name| root(name).exists()));
        found.extend(
            ["src/bin", "examples"].iter().flat_map(|folder| programs(&format!("{package}{folder}"))),
        );
    }
    found
}

/// The roots of every package's test programs and benchmarks.
fn test_programs() -> Vec<String> {
    let folders = ["tests", "benches"];
    let all = packages().into_iter().flat_map(|package| folders.map(|folder| format!("{package}{folder}")));
    all.flat_map(|folder| programs(&folder)).collect()
}

#[test]
fn circles_are_sought_in_every_package() {
    let found = crates();
    for root in [
        "src/lib.rs",
        "src/main.rs",
        "build.rs",
        "jetlink/src/lib.rs",
        "commands/src/lib.rs",
        "host/src/main.rs",
        "emulation/src/lib.rs",
        "emulation/src/bin/emu.rs",
        "examples/embedded/src/main.rs",
        "examples/linux/src/main.rs",
    ] {
        assert!(found.iter().any(|name| name == root), "{root}: {found:?}");
    }
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
    let packages = crates().into_iter().map(|file| {
        let edges = Crate::read(&root(&file)).edges();
        (file, edges)
    });
    let tests = test_programs().into_iter().map(|file| {
        let edges = Crate::read_test_program(&root(&file)).edges();
        (file, edges)
    });
    let found: Vec<String> = packages
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
    ]
    .into_iter()
    .enumerate()
    {
        let folder = std::env::temp_dir().join(format!("jetlink-imports-{}-{i}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("lib.rs"), lib).unwrap();
        std::fs::write(folder.join("a.rs"), a).unwrap();
        std::fs::write(folder.join("b.rs"), b).unwrap();
        let found = circle(&Crate::read(&folder.join("lib.rs")).edges());
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
