// SPDX-License-Identifier: Apache-2.0
// The engine's own samples, played by this browser: a worker of its own takes them from the server
// and gives them to a ring in an AudioWorklet.

export class Listener {
  constructor(link) {
    this.link = link;
    this.latency = null; // s, from the time a sample was meant to sound until it does here
    this.onreport = () => {}; // (latency now)
  }

  get on() {
    return Boolean(this.context);
  }

  // Why nothing can be heard here: a key of the words, or an empty text.
  get hindrance() {
    if (this.link.private.includes('sound')) return 'private_sound';
    return isSecureContext ? '' : 'insecure_sound'; // browsers give an AudioWorklet to HTTPS alone
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
    const { port1, port2 } = new MessageChannel();
    this.node.port.postMessage(port1, [port1]);
    this.wire = new Worker('/static/soundwire.js');
    this.wire.postMessage({ out: port2, pin: this.link.pin }, [port2]);
    await this.context.resume();
  }

  async stop() {
    const { context } = this;
    if (this.wire) this.wire.terminate();
    this.context = this.node = this.wire = null;
    this.latency = null;
    if (context) await context.close();
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
