"use strict";
// What was decided, with undo, redo and autosave. See audit/mod.rs for the data.
const data = JSON.parse(document.getElementById("data").textContent);
const byId = (id) => document.getElementById(id);
const element = (tag, properties = {}, children = []) => {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
};
const seconds = (value) => `${value.toFixed(3)} s`;
const say = (text) => { byId("status").textContent = text; };
const isExpert = () => byId("role").value === "expert";

/** Index of the frame whose timestamp is nearest. */
const nearestFrame = (time) => {
  const after = data.times.findIndex((one) => one >= time);
  if (after < 0) return data.times.length - 1;
  return after > 0 && time - data.times[after - 1] <= data.times[after] - time ? after - 1 : after;
};
/** When a frame stops being shown. */
const endOf = (frame) => data.times[frame + 1] ?? data.end_seconds;

// Decisions outlive the page: browsers close, and an hour's work is lost.
const autosaved = `omnilife audit ${data.source.sha256}`;
let decisions = [];
let unsaved = false;
// Lists of decisions before and after the present one.
const past = [], future = [];
// What the last change was about: steps of one move are one change.
let lastChange = null;
// Called with every new list of decisions.
const listeners = [];

/** Keeps the decisions in this browser; where it has no storage, the page says so. */
const keep = () => {
  const count = `${decisions.length} decision${decisions.length === 1 ? "" : "s"}`;
  unsaved = decisions.length > 0;
  try {
    if (decisions.length) localStorage.setItem(autosaved, JSON.stringify(decisions));
    else localStorage.removeItem(autosaved);
    say(`${count} not saved to a file, kept in this browser`);
  } catch (error) {
    say(`${count} not saved, and this browser keeps none (${error.name})`);
  }
};

const put = (list) => {
  decisions = list;
  for (const listener of listeners) listener();
  keep();
};

/** Replaces the list of decisions; `about` joins steps of one change for undo. */
const change = (list, about = null) => {
  if (about === null || about !== lastChange) past.push(decisions);
  lastChange = about;
  future.length = 0;
  put(list);
};

/** A decision made now, with the reason that is filled in. */
const decision = (action) => {
  const reason = byId("reason").value.trim();
  return { time: new Date().toISOString(), ...(reason && { reason }), action };
};

/** Adds decisions that are undone together. */
const decide = (...actions) => {
  const made = actions.map(decision);
  byId("reason").value = "";
  change([...decisions, ...made]);
};

/** Takes back one decision. */
const withdraw = (one) => change(decisions.filter((other) => other !== one));

const undo = () => {
  if (!past.length) return say("There is nothing to undo.");
  future.push(decisions);
  lastChange = null;
  put(past.pop());
};
const redo = () => {
  if (!future.length) return say("There is nothing to redo.");
  past.push(decisions);
  lastChange = null;
  put(future.pop());
};

/** Decisions that were made here before. */
const restore = () => {
  try {
    const held = JSON.parse(localStorage.getItem(autosaved) ?? "[]");
    if (held.length) put(held);
  } catch (error) {
    say(`What was decided here before cannot be read (${error.name}).`);
  }
};

const save = () => {
  const name = byId("author").value.trim();
  if (!name) {
    byId("author").focus();
    return say("Your name goes into the ledger: please fill it in.");
  }
  // What was only put aside here is nothing that a ledger holds.
  const said = decisions.filter((one) => !one.action.dismiss);
  if (!isExpert() && said.some((one) => !one.action.propose && !one.action.label)) {
    return say("An annotator cannot accept, reject or move what others proposed: undo that, or save as an expert.");
  }
  const file = {
    schema: data.schema, source_sha256: data.source.sha256, author: name, role: byId("role").value, decisions: said,
  };
  const url = URL.createObjectURL(new Blob([JSON.stringify(file, null, 2) + "\n"], { type: "application/json" }));
  element("a", { href: url, download: "decisions.json" }).click();
  setTimeout(() => URL.revokeObjectURL(url), 10000);
  unsaved = false;
  say(`${said.length} decisions saved to decisions.json`);
};
