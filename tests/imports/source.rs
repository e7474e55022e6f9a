//! Reads the sources of a crate, and which of its files import which.

use proc_macro2::{TokenStream, TokenTree};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use syn::punctuated::Punctuated;
use syn::token::Comma;
use syn::{Attribute, Expr, ExprLit, ImplItem, Item, Lit, Meta, TraitItem, UseTree, visit::Visit};

/// The imports between files.
pub type Edges = BTreeMap<PathBuf, BTreeSet<PathBuf>>;

/// A module's place: the idents from the package's root.
pub type Module = Vec<String>;

/// The modules of one crate, and the files of each.
#[derive(Default)]
pub struct Crate {
    /// The file of each module; several, where `cfg` chooses one.
    files: BTreeMap<Module, BTreeSet<PathBuf>>,
    /// The source of each file; without its tests, unless they count.
    pub items: BTreeMap<PathBuf, Vec<(Module, Vec<Item>)>>,
    /// The `use` lines of each module.
    uses: BTreeMap<Module, Uses>,
    /// Names that a module has for other modules, beside its own children.
    names: BTreeMap<Module, BTreeMap<String, Module>>,
    /// Its macros by example.
    macros: Vec<Macro>,
    /// Modules with `#[macro_use]`: their macros also belong to the parent.
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

/// Target of a path.
struct Resolved {
    module: Module,
    /// Modules whose `use` it goes through.
    through: Vec<Module>,
    /// Number of its idents that are not modules.
    rest: usize,
}

impl Crate {
    pub fn read(root: &Path) -> Self {
        Self::default().with(root)
    }

    pub fn read_test_program(root: &Path) -> Self {
        Self { tests_count: true, ..Self::default() }.with(root)
    }

    fn with(mut self, root: &Path) -> Self {
        self.file(root, Vec::new(), root.parent().unwrap());
        self.find_names();
        self
    }

    pub fn skips(&self, attributes: &[Attribute]) -> bool {
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
        self.files.entry(module.clone()).or_default().insert(path.into());
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
                            let places = paths(&inner.attrs);
                            for place in &places {
                                // Its modules lie beside it.
                                let place = path.parent().unwrap().join(place);
                                self.file(&place, child.clone(), place.parent().unwrap());
                            }
                            if !has(&inner.attrs, "path") {
                                let flat = folder.join(format!("{name}.rs"));
                                let deep = folder.join(&name).join("mod.rs");
                                let place = if flat.exists() { flat } else { deep };
                                // Without it, `cfg_attr` has one for every case.
                                if places.is_empty() || place.exists() {
                                    self.file(&place, child, &folder.join(&name));
                                }
                            }
                        }
                    }
                }
                Item::Mod(_) => {}
                item if self.skips(attributes(&item)) => {}
                item => {
                    refuse_includes(path, &item);
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

    /// Resolves each `use` until nothing more is found: one may begin with the name that another one defines.
    fn find_names(&mut self) {
        for (module, items) in self.items.values().flatten() {
            let found = self.uses.entry(module.clone()).or_default();
            items.iter().for_each(|item| found.visit_item(item));
        }
        loop {
            let before = self.names.clone();
            for (module, uses) in &self.uses {
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
        let files = &self.files[module];
        let named = self.macros.iter().filter(|found| found.name == name);
        let places: Vec<&Module> = named.map(|found| &found.module).collect();
        if places.iter().any(|place| self.files[*place] == *files) {
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

    /// The type that a path in a module names: its module, and its name there.
    pub fn type_(&self, module: &Module, path: &[String]) -> Option<Type> {
        self.type_unless_seen(module, path, &mut BTreeSet::new())
    }

    /// The same; a `use` that was `seen` leads nowhere.
    fn type_unless_seen(&self, module: &Module, path: &[String], seen: &mut BTreeSet<Type>) -> Option<Type> {
        let (name, before) = path.split_last()?;
        let module = match before {
            [] => module.clone(),
            before => self.resolve(module, before).filter(|of| of.rest == 0)?.module,
        };
        let own = (module, name.clone());
        if !seen.insert(own.clone()) {
            return None;
        }
        let uses = self.uses.get(&own.0)?;
        if uses.types.contains(name) {
            return Some(own);
        }
        let named = uses.named.iter().filter(|(here, _)| here == name).map(|(_, path)| path.clone());
        let globs = uses.globs.iter().map(|glob| [glob.as_slice(), std::slice::from_ref(name)].concat());
        named.chain(globs).find_map(|path| self.type_unless_seen(&own.0, &path, seen))
    }

    /// Which files import which.
    pub fn imports(&self) -> Edges {
        let mut edges = Edges::new();
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

/// A type: the module that defines it, and its name.
pub type Type = (Module, String);

/// The names that the `use` lines of a module bring in, also those in its functions, and its own types.
#[derive(Default)]
struct Uses {
    /// By their names here.
    named: Vec<(String, Vec<String>)>,
    globs: Vec<Vec<String>>,
    types: BTreeSet<String>,
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

    fn visit_item_struct(&mut self, item: &'ast syn::ItemStruct) {
        self.types.insert(item.ident.to_string());
    }

    fn visit_item_enum(&mut self, item: &'ast syn::ItemEnum) {
        self.types.insert(item.ident.to_string());
    }

    fn visit_item_union(&mut self, item: &'ast syn::ItemUnion) {
        self.types.insert(item.ident.to_string());
    }

    /// An alias is one more name of a type.
    fn visit_item_type(&mut self, item: &'ast syn::ItemType) {
        if let syn::Type::Path(of) = &*item.ty {
            self.named.push((item.ident.to_string(), idents(&of.path)));
        }
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
        self.targets.extend(self.crate_.files[module].iter().cloned());
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

    /// The paths that an attribute is given as text, as serde's are.
    fn texts(&mut self, tokens: TokenStream) {
        for token in tokens {
            match token {
                TokenTree::Group(group) => self.texts(group.stream()),
                TokenTree::Literal(literal) => self.text(&Lit::new(literal)),
                _ => {}
            }
        }
    }

    fn text(&mut self, literal: &Lit) {
        if let Lit::Str(text) = literal
            && let Ok(path) = text.parse::<syn::Path>()
        {
            self.inline(&idents(&path));
        }
    }

    /// The paths in a macro's arguments or definition. `before`: the path of the braces around them; `depth`: how many
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

pub fn idents(path: &syn::Path) -> Vec<String> {
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

    fn visit_attribute(&mut self, attribute: &'ast Attribute) {
        match &attribute.meta {
            Meta::List(list) => {
                self.tokens(list.tokens.clone(), &[], 0);
                self.texts(list.tokens.clone());
            }
            // Links of the documentation are not imports.
            Meta::NameValue(value) if !value.path.is_ident("doc") => match &value.value {
                Expr::Lit(ExprLit { lit, .. }) => self.text(lit),
                value => self.visit_expr(value),
            },
            Meta::NameValue(_) | Meta::Path(_) => {}
        }
    }

    fn visit_item(&mut self, item: &'ast Item) {
        if !self.crate_.skips(attributes(item)) {
            syn::visit::visit_item(self, item);
        }
    }

    fn visit_impl_item(&mut self, item: &'ast ImplItem) {
        if !self.crate_.skips(attributes_in_impl(item)) {
            syn::visit::visit_impl_item(self, item);
        }
    }

    fn visit_trait_item(&mut self, item: &'ast TraitItem) {
        if !self.crate_.skips(attributes_in_trait(item)) {
            syn::visit::visit_trait_item(self, item);
        }
    }
}

pub fn attributes(item: &Item) -> &[Attribute] {
    match item {
        Item::Const(item) => &item.attrs,
        Item::Enum(item) => &item.attrs,
        Item::ExternCrate(item) => &item.attrs,
        Item::Fn(item) => &item.attrs,
        Item::ForeignMod(item) => &item.attrs,
        Item::Impl(item) => &item.attrs,
        Item::Macro(item) => &item.attrs,
        Item::Mod(item) => &item.attrs,
        Item::Static(item) => &item.attrs,
        Item::Struct(item) => &item.attrs,
        Item::Trait(item) => &item.attrs,
        Item::TraitAlias(item) => &item.attrs,
        Item::Type(item) => &item.attrs,
        Item::Union(item) => &item.attrs,
        Item::Use(item) => &item.attrs,
        _ => &[],
    }
}

pub fn attributes_in_impl(item: &ImplItem) -> &[Attribute] {
    match item {
        ImplItem::Const(item) => &item.attrs,
        ImplItem::Fn(item) => &item.attrs,
        ImplItem::Macro(item) => &item.attrs,
        ImplItem::Type(item) => &item.attrs,
        _ => &[],
    }
}

fn attributes_in_trait(item: &TraitItem) -> &[Attribute] {
    match item {
        TraitItem::Const(item) => &item.attrs,
        TraitItem::Fn(item) => &item.attrs,
        TraitItem::Macro(item) => &item.attrs,
        TraitItem::Type(item) => &item.attrs,
        _ => &[],
    }
}

fn is_test(attributes: &[Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        attribute.path().is_ident("test")
            || attribute.path().is_ident("cfg")
                && attribute.parse_args::<Meta>().is_ok_and(|condition| needs_test(&condition))
    })
}

/// Whether a `cfg` is true in tests alone.
fn needs_test(condition: &Meta) -> bool {
    let inner = |list: &syn::MetaList| {
        list.parse_args_with(Punctuated::<Meta, Comma>::parse_terminated).unwrap_or_default()
    };
    match condition {
        Meta::Path(path) => path.is_ident("test"),
        Meta::List(list) if list.path.is_ident("all") => inner(list).iter().any(needs_test),
        Meta::List(list) if list.path.is_ident("any") => inner(list).iter().all(needs_test),
        _ => false,
    }
}

fn has(attributes: &[Attribute], name: &str) -> bool {
    attributes.iter().any(|attribute| attribute.path().is_ident(name))
}

/// The files that `#[path = "..."]` names, also in `cfg_attr`.
fn paths(attributes: &[Attribute]) -> Vec<String> {
    fn of(meta: &Meta) -> Vec<String> {
        match meta {
            Meta::NameValue(syn::MetaNameValue {
                path,
                value: Expr::Lit(ExprLit { lit: Lit::Str(text), .. }),
                ..
            }) if path.is_ident("path") => vec![text.value()],
            Meta::List(list) if list.path.is_ident("cfg_attr") => {
                let inner = list.parse_args_with(Punctuated::<Meta, Comma>::parse_terminated);
                inner.into_iter().flatten().skip(1).flat_map(|meta| of(&meta)).collect()
            }
            _ => Vec::new(),
        }
    }
    attributes.iter().flat_map(|attribute| of(&attribute.meta)).collect()
}

/// Panics at an `include!` of a file that `build.rs` has not generated.
fn refuse_includes(file: &Path, item: &Item) {
    struct Includes<'a>(&'a Path);

    impl Includes<'_> {
        fn call(&self, what: &TokenStream) {
            assert!(
                what.to_string().contains("OUT_DIR"),
                "{}: nothing reads the imports of include!({what}): make it a module",
                self.0.display()
            );
        }

        fn tokens(&self, tokens: TokenStream) {
            let tokens: Vec<TokenTree> = tokens.into_iter().collect();
            for (i, token) in tokens.iter().enumerate() {
                let TokenTree::Group(group) = token else { continue };
                let called = tokens[..i].iter().rev().take(2).map(ToString::to_string);
                if called.eq(["!", "include"]) {
                    self.call(&group.stream());
                }
                self.tokens(group.stream());
            }
        }
    }

    impl<'ast> Visit<'ast> for Includes<'_> {
        fn visit_macro(&mut self, found: &'ast syn::Macro) {
            if found.path.segments.last().is_some_and(|last| last.ident == "include") {
                self.call(&found.tokens);
            }
            self.tokens(found.tokens.clone());
        }
    }

    Includes(file).visit_item(item);
}

pub fn root(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(file)
}
