// Takes the pictures of a camera in a worker: a tab that is hidden has no frames of the screen, and its timers sleep.
self.onmessage = async ({ data: { readable, quality } }) => {
  const reader = readable.getReader(),
    canvas = new OffscreenCanvas(16, 9),
    context = canvas.getContext("2d");
  for (;;) {
    const { done, value: frame } = await reader.read();
    if (done) return;
    const made = performance.timeOrigin + performance.now();
    if (canvas.width !== frame.displayWidth || canvas.height !== frame.displayHeight) {
      canvas.width = frame.displayWidth;
      canvas.height = frame.displayHeight;
    }
    context.drawImage(frame, 0, 0);
    frame.close();
    const blob = await canvas.convertToBlob({ type: "image/jpeg", quality });
    const bytes = await blob.arrayBuffer();
    postMessage({ bytes, made }, [bytes]);
  }
};
