// A page that is opened from the disk may not start workers; the search runs in one. Here it runs in a hidden frame.
class FrameWorker extends EventTarget {
  constructor(url) {
    super()
    this.frame = document.createElement("iframe")
    this.frame.hidden = true
    document.body.appendChild(this.frame)
    const inside = this.frame.contentWindow
    inside.document.open()
    inside.document.write(`<html><body><script>
      postMessage = data => parent.postMessage(data, "*")
      importScripts = (...urls) => urls.reduce((before, url) => before.then(() => new Promise(resolve => {
        const script = document.createElement("script")
        script.src = url
        script.addEventListener("load", resolve)
        document.body.appendChild(script)
      })), Promise.resolve())
    </script><script src="${url}"></script></body></html>`)
    inside.document.close()
    this.ready = new Promise(resolve => { inside.onload = resolve })
    addEventListener("message", event => {
      if (event.source !== this.frame.contentWindow) return
      this.dispatchEvent(new MessageEvent("message", { data: event.data }))
      if (this.onmessage) this.onmessage(event)
    })
  }
  postMessage(data) {
    this.ready.then(() => this.frame.contentWindow.dispatchEvent(new MessageEvent("message", { data })))
  }
  terminate() { this.frame.remove() }
}
if (location.protocol === "file:") window.Worker = FrameWorker
