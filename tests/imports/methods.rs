//! The methods of one type go one way, too, where its `impl` is in several files: imports do not show their calls of one another.
//!
//! A call is `self.name(...)`, `Self::name(...)` or `Type::name(...)`, also in a macro, that names an inherent method of the type.

use crate::{Crate, circle, root};
use proc_macro2::{TokenStream, TokenTree};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use syn::{Expr, ImplItem, Item, visit::Visit};

type Edges = BTreeMap<PathBuf, BTreeSet<PathBuf>>;

/// The methods of a type: the file of each, and the calls of each file.
struct Methods {
    files: BTreeMap<String, PathBuf>,
    calls: BTreeMap<PathBuf, BTreeSet<String>>,
}

impl Methods {
    fn of(crate_: &Crate, type_: &str) -> Self {
        let mut found = Self { files: BTreeMap::new(), calls: BTreeMap::new() };
        for (file, item) in impls(crate_, type_) {
            for inner in &item.items {
                if let ImplItem::Fn(method) = inner {
                    found.files.insert(method.sig.ident.to_string(), file.clone());
                }
            }
            let mut calls = Calls { type_, names: BTreeSet::new() };
            calls.visit_item_impl(item);
            found.calls.entry(file.clone()).or_default().extend(calls.names);
        }
        found
    }

    /// Which files call a method of which.
    fn edges(&self) -> Edges {
        let mut edges = Edges::new();
        for (file, names) in &self.calls {
            let targets = names.iter().filter_map(|name| self.files.get(name));
            edges.entry(file.clone()).or_default().extend(targets.filter(|target| *target != file).cloned());
        }
        edges
    }
}

/// Each inherent `impl` of a type, with its file.
fn impls<'a>(crate_: &'a Crate, type_: &str) -> impl Iterator<Item = (&'a PathBuf, &'a syn::ItemImpl)> {
    let items = crate_.items.iter().flat_map(|(file, modules)| {
        modules.iter().flat_map(move |(_, items)| items.iter().map(move |item| (file, item)))
    });
    items.filter_map(move |(file, item)| match item {
        Item::Impl(item) if item.trait_.is_none() && names(&item.self_ty, type_) => Some((file, item)),
        _ => None,
    })
}

fn names(of: &syn::Type, type_: &str) -> bool {
    matches!(of, syn::Type::Path(path) if path.path.segments.last().is_some_and(|last| last.ident == type_))
}

struct Calls<'a> {
    type_: &'a str,
    names: BTreeSet<String>,
}

impl Calls<'_> {
    fn tokens(&mut self, tokens: TokenStream) {
        let tokens: Vec<TokenTree> = tokens.into_iter().collect();
        for (i, token) in tokens.iter().enumerate() {
            match token {
                TokenTree::Group(group) => self.tokens(group.stream()),
                TokenTree::Ident(ident) => {
                    let before: Vec<String> =
                        tokens[..i].iter().rev().take(3).map(ToString::to_string).collect();
                    let called = matches!(tokens.get(i + 1), Some(TokenTree::Group(_)));
                    let found = match before.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
                        [".", "self", ..] => called,
                        [":", ":", of] => *of == "Self" || *of == self.type_,
                        _ => false,
                    };
                    if found {
                        self.names.insert(ident.to_string());
                    }
                }
                _ => {}
            }
        }
    }
}

impl<'ast> Visit<'ast> for Calls<'_> {
    fn visit_expr_method_call(&mut self, call: &'ast syn::ExprMethodCall) {
        if is_self(&call.receiver) {
            self.names.insert(call.method.to_string());
        }
        syn::visit::visit_expr_method_call(self, call);
    }

    fn visit_expr_path(&mut self, path: &'ast syn::ExprPath) {
        let idents: Vec<String> =
            path.path.segments.iter().map(|segment| segment.ident.to_string()).collect();
        if let [.., of, name] = idents.as_slice()
            && (of == "Self" || of == self.type_)
        {
            self.names.insert(name.clone());
        }
        syn::visit::visit_expr_path(self, path);
    }

    fn visit_macro(&mut self, found: &'ast syn::Macro) {
        self.tokens(found.tokens.clone());
    }
}

fn is_self(expr: &Expr) -> bool {
    matches!(expr, Expr::Path(path) if path.path.is_ident("self"))
}

/// Whether this is `self.name`.
fn is_field(expr: &Expr, name: &str) -> bool {
    matches!(expr, Expr::Field(field) if is_self(&field.base)
        && matches!(&field.member, syn::Member::Named(field) if field == name))
}

/// The files in which an engine's mode is set, and those in which its link gets an order.
#[derive(Default)]
struct Deeds {
    sets_mode: bool,
    gives_order: bool,
}

impl<'ast> Visit<'ast> for Deeds {
    fn visit_expr_assign(&mut self, assign: &'ast syn::ExprAssign) {
        self.sets_mode |= is_field(&assign.left, "mode");
        syn::visit::visit_expr_assign(self, assign);
    }

    fn visit_expr_method_call(&mut self, call: &'ast syn::ExprMethodCall) {
        self.gives_order |= call.method == "order" && is_field(&call.receiver, "link");
        syn::visit::visit_expr_method_call(self, call);
    }
}

fn both(crate_: &Crate, type_: &str) -> Edges {
    let mut edges = crate_.edges();
    for (file, targets) in Methods::of(crate_, type_).edges() {
        edges.entry(file).or_default().extend(targets);
    }
    edges
}

fn engine(file: &str) -> PathBuf {
    root("jetlink/src/engine").join(file)
}

#[test]
fn methods_of_the_engine_and_imports_together_have_no_circle() {
    let found = circle(&both(&Crate::read(&root("jetlink/src/lib.rs")), "Engine"));
    assert_eq!(found, None);
}

#[test]
fn every_kind_of_call_is_seen() {
    let edges = Methods::of(&Crate::read(&root("jetlink/src/lib.rs")), "Engine").edges();
    let calls = |from: &str, to: &str| edges.get(&engine(from)).is_some_and(|to_| to_.contains(&engine(to)));
    for (from, to) in [
        ("mod.rs", "commands.rs"),
        ("mod.rs", "judging.rs"),
        ("commands.rs", "steps.rs"),
        ("steps.rs", "sending.rs"),
        ("sending.rs", "deadlines.rs"),
    ] {
        assert!(calls(from, to) && !calls(to, from), "{from} calls {to}");
    }
}

#[test]
fn the_mode_is_set_in_steps_alone_and_the_link_gets_orders_from_sending_alone() {
    let crate_ = Crate::read(&root("jetlink/src/lib.rs"));
    let (mut modes, mut orders) = (BTreeSet::new(), BTreeSet::new());
    for (file, item) in impls(&crate_, "Engine") {
        let mut deeds = Deeds::default();
        deeds.visit_item_impl(item);
        modes.extend(deeds.sets_mode.then(|| file.clone()));
        orders.extend(deeds.gives_order.then(|| file.clone()));
    }
    assert_eq!(modes, BTreeSet::from([engine("steps.rs")]));
    assert_eq!(orders, BTreeSet::from([engine("sending.rs")]));
}

#[test]
fn planted_circle_of_methods_is_found() {
    let folder = std::env::temp_dir().join(format!("jetlink-methods-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
    let found = |lib: &Path| circle(&both(&Crate::read(lib), "E"));
    write("lib.rs", "mod a;\nmod b;\nmod c;\n");
    write("c.rs", "pub struct E;");
    for (what, a, b) in [
        ("method", "use crate::c::E; impl E { fn a(&self) { self.b() } }", "fn b(&self) { self.a() }"),
        (
            "macro",
            "use crate::c::E; impl E { fn a(&self) { assert!(self.b()) } }",
            "fn b(&self) { self.a() }",
        ),
        ("path", "use crate::c::E; impl E { fn a(&self) { Self::b() } }", "fn b() { E::a() }"),
        (
            "path in a macro",
            "use crate::c::E; impl E { fn a(&self) { dbg!(E::b()) } }",
            "fn b() { Self::a() }",
        ),
        (
            "an import back",
            "use crate::c::E; impl E { fn a(&self) { self.b() } }",
            "fn b() { crate::a::x() }",
        ),
    ] {
        write("a.rs", a);
        write("b.rs", &format!("use crate::c::E; impl E {{ {b} }}"));
        let circle = found(&folder.join("lib.rs"));
        // Another type's method of this name is none of the type.
        write("b.rs", "use crate::c::E; impl E { fn b(&self, o: &O) { o.a(); self.o.a() } }");
        let none = found(&folder.join("lib.rs"));
        assert_eq!((circle.map(|files| files.len()), none), (Some(2), None), "{what}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}
