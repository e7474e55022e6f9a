//! Method calls of one type also go one way, where its `impl` is in several files: imports do not show these calls.
//!
//! A call is `self.name(...)`, `self.field.name(...)` or `Self::name(...)` in an `impl`, or `Type::name(...)` anywhere, that
//! names an inherent method or constant of the type; in a macro all of these except that of a field. Definitions in a macro are
//! not seen, nor are method calls on a variable.

use crate::source::{Crate, Edges, Module, Type, attributes, attributes_in_impl, idents, root};
use proc_macro2::{TokenStream, TokenTree};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use syn::{Expr, ImplItem, Item, visit::Visit};

/// Which files call a method that another file's `impl` of a type has.
pub fn edges(crate_: &Crate) -> Edges {
    let (definitions, fields) = (definitions(crate_), fields(crate_));
    let mut edges = Edges::new();
    for (file, modules) in &crate_.items {
        for (module, items) in modules {
            let mut calls = Calls { crate_, fields: &fields, module, of: None, found: BTreeSet::new() };
            items.iter().for_each(|item| calls.visit_item(item));
            let targets = calls.found.iter().filter_map(|call| definitions.get(call)).flatten();
            edges.entry(file.clone()).or_default().extend(targets.filter(|target| *target != file).cloned());
        }
    }
    edges
}

/// The files of each method; several, where `cfg` chooses one.
fn definitions(crate_: &Crate) -> BTreeMap<(Type, String), BTreeSet<PathBuf>> {
    let mut found = BTreeMap::<_, BTreeSet<PathBuf>>::new();
    for (file, type_, item) in impls(crate_) {
        for inner in item.items.iter().filter(|inner| !crate_.skips(attributes_in_impl(inner))) {
            let name = match inner {
                ImplItem::Fn(method) => &method.sig.ident,
                ImplItem::Const(constant) => &constant.ident,
                _ => continue,
            };
            found.entry((type_.clone(), name.to_string())).or_default().insert(file.clone());
        }
    }
    found
}

/// The types of fields, where they are a type of the crate or a reference to one.
fn fields(crate_: &Crate) -> BTreeMap<(Type, String), Type> {
    let structs = items(crate_).filter_map(|(_, module, item)| match item {
        Item::Struct(item) => Some((module, item)),
        _ => None,
    });
    let fields =
        structs.flat_map(|(module, item)| item.fields.iter().map(move |field| (module, item, field)));
    let types = fields.filter_map(|(module, item, field)| {
        let type_ = type_of(crate_, module, &field.ty)?;
        Some((((module.clone(), item.ident.to_string()), field.ident.as_ref()?.to_string()), type_))
    });
    types.collect()
}

fn items(crate_: &Crate) -> impl Iterator<Item = (&PathBuf, &Module, &Item)> {
    let modules =
        crate_.items.iter().flat_map(|(file, modules)| modules.iter().map(move |module| (file, module)));
    modules.flat_map(|(file, (module, items))| items.iter().map(move |item| (file, module, item)))
}

/// Each inherent `impl`, with its file and its type.
fn impls(crate_: &Crate) -> impl Iterator<Item = (&PathBuf, Type, &syn::ItemImpl)> {
    items(crate_).filter_map(|(file, module, item)| match item {
        Item::Impl(item) if item.trait_.is_none() => {
            Some((file, type_of(crate_, module, &item.self_ty)?, item))
        }
        _ => None,
    })
}

fn type_of(crate_: &Crate, module: &Module, type_: &syn::Type) -> Option<Type> {
    match type_ {
        syn::Type::Path(path) => crate_.type_(module, &idents(&path.path)),
        syn::Type::Reference(of) => type_of(crate_, module, &of.elem),
        _ => None,
    }
}

/// The calls in one module.
struct Calls<'a> {
    crate_: &'a Crate,
    fields: &'a BTreeMap<(Type, String), Type>,
    module: &'a Module,
    /// The type whose `impl` is visited.
    of: Option<Type>,
    found: BTreeSet<(Type, String)>,
}

impl Calls<'_> {
    fn of_self(&mut self, name: &str) {
        let found = self.of.clone().map(|type_| (type_, name.into()));
        self.found.extend(found);
    }

    /// The type of `self`, or of a field of it.
    fn type_of(&self, expr: &Expr) -> Option<Type> {
        match expr {
            _ if is_self(expr) => self.of.clone(),
            Expr::Field(syn::ExprField { base, member: syn::Member::Named(name), .. }) => {
                self.fields.get(&(self.type_of(base)?, name.to_string())).cloned()
            }
            _ => None,
        }
    }

    /// A path that may end with a type and its method.
    fn path(&mut self, path: &[String]) {
        match path {
            [of, name] if of == "Self" => self.of_self(name),
            [of @ .., name] if !of.is_empty() => {
                let found = self.crate_.type_(self.module, of).map(|type_| (type_, name.clone()));
                self.found.extend(found);
            }
            _ => {}
        }
    }

    fn tokens(&mut self, tokens: TokenStream) {
        let tokens: Vec<TokenTree> = tokens.into_iter().collect();
        let mut path = Vec::new();
        for (i, token) in tokens.iter().enumerate() {
            match token {
                TokenTree::Group(group) => self.tokens(group.stream()),
                TokenTree::Ident(ident) => {
                    let before: Vec<String> =
                        tokens[..i].iter().rev().take(2).map(ToString::to_string).collect();
                    let before: Vec<&str> = before.iter().map(String::as_str).collect();
                    if before != [":", ":"] {
                        path.clear();
                    }
                    path.push(ident.to_string());
                    let called = matches!(tokens.get(i + 1), Some(TokenTree::Group(_)));
                    match before.as_slice() {
                        [".", "self"] if called => self.of_self(&ident.to_string()),
                        [":", ":"] => self.path(&path),
                        _ => {}
                    }
                }
                _ => {}
            }
        }
    }
}

impl<'ast> Visit<'ast> for Calls<'_> {
    fn visit_item(&mut self, item: &'ast Item) {
        if !self.crate_.skips(attributes(item)) {
            syn::visit::visit_item(self, item);
        }
    }

    fn visit_item_impl(&mut self, item: &'ast syn::ItemImpl) {
        let of = type_of(self.crate_, self.module, &item.self_ty);
        let outer = std::mem::replace(&mut self.of, of);
        syn::visit::visit_item_impl(self, item);
        self.of = outer;
    }

    fn visit_impl_item(&mut self, item: &'ast ImplItem) {
        if !self.crate_.skips(attributes_in_impl(item)) {
            syn::visit::visit_impl_item(self, item);
        }
    }

    fn visit_expr_method_call(&mut self, call: &'ast syn::ExprMethodCall) {
        let found = self.type_of(&call.receiver).map(|type_| (type_, call.method.to_string()));
        self.found.extend(found);
        syn::visit::visit_expr_method_call(self, call);
    }

    fn visit_expr_path(&mut self, found: &'ast syn::ExprPath) {
        let path = idents(&found.path);
        match &found.qself {
            // `<Type>::name`
            Some(of) if of.position == 0 => {
                if let syn::Type::Path(of) = &*of.ty {
                    self.path(&[idents(&of.path), path].concat());
                }
            }
            _ => self.path(&path),
        }
        syn::visit::visit_expr_path(self, found);
    }

    fn visit_macro(&mut self, found: &'ast syn::Macro) {
        self.tokens(found.tokens.clone());
    }
}

/// Whether this is `self`, also `&self` or `(*self)`.
fn is_self(expr: &Expr) -> bool {
    match expr {
        Expr::Path(path) => path.path.is_ident("self"),
        Expr::Paren(inner) => is_self(&inner.expr),
        Expr::Reference(inner) => is_self(&inner.expr),
        Expr::Unary(syn::ExprUnary { op: syn::UnOp::Deref(_), expr, .. }) => is_self(expr),
        _ => false,
    }
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

fn engine(file: &str) -> PathBuf {
    root("jetlink/src/engine").join(file)
}

#[test]
fn every_kind_of_call_is_seen() {
    let edges = edges(&Crate::read(&root("jetlink/src/lib.rs")));
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
    let engine_type = (vec!["engine".into(), "data".into()], "Engine".into());
    for (file, _, item) in impls(&crate_).filter(|(_, type_, _)| *type_ == engine_type) {
        let mut deeds = Deeds::default();
        deeds.visit_item_impl(item);
        modes.extend(deeds.sets_mode.then(|| file.clone()));
        orders.extend(deeds.gives_order.then(|| file.clone()));
    }
    assert_eq!(modes, BTreeSet::from([engine("steps.rs")]));
    assert_eq!(orders, BTreeSet::from([engine("sending.rs")]));
}
