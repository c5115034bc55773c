// SPDX-License-Identifier: Apache-2.0
// A worker with a connection of its own for the sound: what the page is busy with does not delay it.
// Samples go straight to the audio thread, through the port that the page hands over.

const RETRY_MS = 1000;
let port = null;
let pin = '';

onmessage = ({ data }) => {
  ({ out: port, pin } = data);
  open();
};

function open() {
  const socket = new WebSocket(`${location.protocol === 'https:' ? 'wss' : 'ws'}://${location.host}/live`);
  socket.binaryType = 'arraybuffer';
  socket.onopen = () => {
    if (pin) socket.send(JSON.stringify({ pin }));
    socket.send(JSON.stringify({ wants: ['sound'] }));
  };
  socket.onmessage = ({ data }) => {
    if (typeof data === 'string') return;
    const view = new DataView(data);
    const samples = new Int16Array(data.slice(24));
    const [channels, rate, stamp] = [view.getUint8(1), view.getUint32(4, true), view.getFloat64(8, true)];
    port.postMessage({ stamp, rate, channels, samples }, [samples.buffer]);
  };
  socket.onclose = () => setTimeout(open, RETRY_MS);
}
