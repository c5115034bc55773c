// SPDX-License-Identifier: Apache-2.0
// The engine's own samples, played by this browser: packets go into a ring in an AudioWorklet.

export class Listener {
  constructor(link) {
    this.link = link;
    this.latency = null; // s, from the time a sample was meant to sound until it does here
    this.onreport = () => {}; // (latency now)
    link.on('sound', (packet) => this.take(packet));
  }

  get on() {
    return Boolean(this.context);
  }

  async start() {
    if (this.context) return;
    this.context = new AudioContext({ latencyHint: 'interactive', sampleRate: 48000 });
    await this.context.audioWorklet.addModule('/static/worklet.js');
    if (!this.context) return;
    this.node = new AudioWorkletNode(this.context, 'ring', {
      numberOfInputs: 0,
      outputChannelCount: [2],
    });
    this.node.port.onmessage = ({ data }) => this.report(data);
    this.node.connect(this.context.destination);
    await this.context.resume();
  }

  async stop() {
    const { context } = this;
    this.context = this.node = null;
    this.latency = null;
    if (context) await context.close();
  }

  take({ view, data, stamp }) {
    if (!this.node) return;
    const channels = view.getUint8(1);
    const rate = view.getUint32(4, true);
    const samples = new Int16Array(data.slice(24));
    this.node.port.postMessage({ stamp, rate, channels, samples }, [samples.buffer]);
  }

  // The worklet tells which stamp it just gave out, at which time of the audio clock.
  report({ stamp, time, level, starved, packets }) {
    const { context } = this;
    if (!context) return;
    this.level = level;
    this.starved = starved;
    this.packets = packets;
    if (stamp) {
      const output = context.outputLatency || context.baseLatency || 0;
      const sounds = this.link.now() + (time - context.currentTime) + output;
      const late = sounds - stamp;
      this.latency = this.latency === null ? late : this.latency + 0.1 * (late - this.latency);
      this.onreport(late);
    }
  }
}
