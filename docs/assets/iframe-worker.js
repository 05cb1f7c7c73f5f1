// Lets the search run in pages opened as files, where browsers refuse workers: runs the worker's script in a hidden frame.
"use strict";
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      this.frame = document.createElement("iframe");
      this.frame.hidden = true;
      this.waiting = [];
      window.addEventListener("message", (event) => {
        if (event.source !== this.frame.contentWindow) return;
        if (event.data === "ready") {
          this.waiting.splice(0).forEach((data) => this.send(data));
          this.waiting = null;
        } else {
          this.dispatchEvent(new MessageEvent("message", { data: event.data }));
        }
      });
      this.frame.srcdoc = `<!doctype html><script>
        var importScripts = (...urls) => urls.reduce((before, url) => before.then(() => new Promise((done, failed) => {
          const script = document.createElement("script");
          Object.assign(script, { src: url, onload: done, onerror: failed });
          document.head.appendChild(script);
        })), Promise.resolve());
        var postMessage = (data) => parent.postMessage(data, "*");
        onload = () => parent.postMessage("ready", "*");
      </script><script src="${new URL(url, location.href)}"></script>`;
      document.body.appendChild(this.frame);
    }

    send(data) {
      this.frame.contentWindow.dispatchEvent(new MessageEvent("message", { data }));
    }

    postMessage(data) {
      if (this.waiting) this.waiting.push(data);
      else this.send(data);
    }

    terminate() {
      this.frame.remove();
    }
  };
}
