// No browser starts a web worker from a file on disk. There the theme's search runs in a hidden frame instead.
// In place of iframe-worker, which the theme would load from a network; the theme knows it by the name IFrameWorker.
if (location.protocol === "file:") {
  window.Worker = window.IFrameWorker = class extends EventTarget {
    constructor(url) {
      super()
      this.frame = document.createElement("iframe")
      this.frame.hidden = true
      const answer = `window.postMessage = data => parent.postMessage(data, "*")`
      this.frame.srcdoc = `<script>${answer}</script><script src="${url}"></script>`
      this.ready = new Promise(resolve => this.frame.addEventListener("load", resolve))
      window.addEventListener("message", event => {
        if (event.source === this.frame.contentWindow)
          this.dispatchEvent(new MessageEvent("message", { data: event.data }))
      })
      document.body.append(this.frame)
    }
    postMessage(data) {
      this.ready.then(() => this.frame.contentWindow.dispatchEvent(new MessageEvent("message", { data })))
    }
    terminate() {
      this.frame.remove()
    }
  }
}
