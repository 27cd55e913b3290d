// Who has the controls, since when, and what this page may do about it: take them, ask for them, give them, take over.

import { ago, byId, make, setText } from "./format.js";

export class Authority {
  /** @param ask sends a request: (what, value, text); @param lost called with who took the controls from this page */
  constructor(ask, lost) {
    this.ask = ask;
    this.lost = lost;
    this.mine = false;
    this.gave = "";
    this.shown = "";
    byId("take-dialog").addEventListener("close", (event) => {
      const reason = byId("take-reason").value.trim();
      if (event.target.returnValue === "take" && reason) this.ask("take", null, reason);
      event.target.returnValue = "";
      byId("take-reason").value = "";
    });
  }

  /** @returns whether this page may drive now, as far as authority goes */
  show(state, facts, page, connected) {
    const { lease, seat } = state;
    const asking = lease.asking ?? [];
    const mine = seat.shared ? lease.holder === facts.user || !lease.holder : seat.page === page;
    const driver = facts.role !== "viewer";
    const taken = this.mine && !mine && lease.holder && ![facts.user, this.gave].includes(lease.holder);
    if (taken && !seat.shared) this.lost(lease.holder);
    if (mine !== this.mine) this.gave = "";
    this.mine = mine;
    setText(byId("holder"), mine && asking.length ? `${asking[0]} asks for the controls` : holderText(state, mine, facts));
    byId("holder").title = [byId("holder").textContent, peopleText(state.people)].filter(Boolean).join(". ");
    const rows = [];
    if (connected && driver && !(seat.shared && mine)) {
      if (mine) {
        for (const name of asking.slice(0, 1)) {
          rows.push([`Give to ${name}`, "grant", name], ["Not now", "refuse", name]);
        }
        rows.push(["Let go", "release", ""]);
      } else if (lease.holder && lease.fresh) {
        const asked = asking.includes(facts.user);
        rows.push(asked ? ["Withdraw", "withdraw", ""] : ["Ask for them", "ask", ""]);
        if (lease.holder === facts.user) rows.push(["Take here", "acquire", ""]);
        if (facts.role === "admin") rows.push(["Take over …", "take", ""]);
      } else {
        rows.push(["Take the controls", "acquire", ""]);
      }
    }
    this.#showRows(rows);
    return driver && (mine || seat.shared);
  }

  #showRows(rows) {
    const key = JSON.stringify(rows);
    if (key === this.shown) return;
    this.shown = key;
    byId("authority").replaceChildren(...rows.map(([label, what, name]) => {
      const button = make("button", what === "acquire" || what === "grant" ? "primary" : "", label);
      button.type = "button";
      button.dataset.testid = `controls-${what}`;
      button.addEventListener("click", () => {
        if (what === "grant") this.gave = name;
        if (what === "take") byId("take-dialog").showModal();
        else this.ask(what, null, name);
      });
      return button;
    }));
  }
}

function holderText({ lease }, mine, facts) {
  if (!lease.holder) return "Nobody has the controls";
  const who = mine && lease.holder === facts.user ? "You have" : `${lease.holder} has`;
  const since = Number.isFinite(lease.since_s) ? ` since ${ago(lease.since_s)}` : "";
  return `${who} the controls${since}${lease.fresh ? "" : ", but is not heard of"}`;
}

function peopleText(people) {
  return people.length > 1 ? `Here: ${people.map(({ name, role }) => `${name} (${role})`).join(", ")}` : "";
}
