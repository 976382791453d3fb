"use strict";
// Pictures from the program that serves this page, and orders to it.
{
  const token = new URLSearchParams(location.search).get("token") ?? "";
  const address = (path) => `${path}?token=${encodeURIComponent(token)}`;
  const view = liveView(document, (order) => fetch(address(`/${order}`), { method: "POST" }).then((answer) => answer.ok, () => false));
  const events = new EventSource(address("/events"));
  events.onmessage = ({ data }) => {
    const shown = JSON.parse(data), source = document.getElementById("source");
    if (source.textContent !== shown.source) source.textContent = shown.source;
    view.show(shown);
  };
  events.addEventListener("end", () => { events.close(); view.say("the program has ended"); });
  events.onerror = () => {
    const isOver = events.readyState === EventSource.CLOSED;
    view.say(isOver ? "no connection: open the address that the program has printed" : "no connection; trying again");
  };
}
