// SPDX-License-Identifier: Apache-2.0
// A ring of samples between the network and the sound card. Reads a little faster or slower (at most
// 0.5 %, inaudible) to hold its fill, so two clocks that differ never run it empty or full.

const LENGTH = 48000;

class Ring extends AudioWorkletProcessor {
  constructor({ processorOptions }) {
    super();
    this.lead = processorOptions.lead;
    this.left = new Float32Array(LENGTH);
    this.right = new Float32Array(LENGTH);
    this.written = 0; // samples since the start
    this.read = 0; // fractional
    this.rate = sampleRate;
    this.playing = false;
    this.starved = this.packets = this.level = this.blocks = 0;
    this.stampOfWritten = 0;
    this.port.onmessage = ({ data }) => this.take(data);
  }

  take({ stamp, rate, channels, samples }) {
    this.rate = rate;
    const count = samples.length / channels;
    for (let i = 0; i < count; i++) {
      const at = (this.written + i) % LENGTH;
      this.left[at] = samples[i * channels] / 32768;
      this.right[at] = samples[i * channels + (channels > 1 ? 1 : 0)] / 32768;
    }
    this.written += count;
    this.stampOfWritten = stamp + count / rate;
    this.packet = count;
    this.packets++;
    const most = Math.max(4 * this.lead * rate, 4 * count);
    if (this.written - this.read > most) this.read = this.written - this.wanted();
  }

  wanted() {
    return Math.max(this.lead * this.rate, 1.5 * (this.packet || 0));
  }

  process(_, [output]) {
    const [left, right] = output;
    const frames = left.length;
    const fill = this.written - this.read;
    if (!this.playing && fill >= this.wanted()) this.playing = true;
    if (this.playing && fill < frames * 2) {
      this.playing = false;
      this.starved++;
    }
    if (this.playing) {
      const error = (fill - this.wanted()) / this.wanted();
      const step = (this.rate / sampleRate) * (1 + Math.min(Math.max(0.005 * error, -0.005), 0.005));
      for (let i = 0; i < frames; i++) {
        const whole = Math.floor(this.read);
        const part = this.read - whole;
        const [a, b] = [whole % LENGTH, (whole + 1) % LENGTH];
        left[i] = this.left[a] * (1 - part) + this.left[b] * part;
        if (right) right[i] = this.right[a] * (1 - part) + this.right[b] * part;
        this.level = Math.max(this.level, Math.abs(left[i]));
        this.read += step;
      }
    }
    if (++this.blocks % 32 === 0) {
      const stamp = this.playing ? this.stampOfWritten - (this.written - this.read) / this.rate : 0;
      this.port.postMessage({
        stamp, time: currentTime, level: this.level, starved: this.starved, packets: this.packets,
      });
      this.level = 0;
    }
    return true;
  }
}

registerProcessor('ring', Ring);
