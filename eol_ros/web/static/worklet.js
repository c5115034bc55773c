// SPDX-License-Identifier: Apache-2.0
// A ring of samples between the network and the sound card.
//
// What matters is the least fill: as long as it stays above a margin, nothing is missed. Once a second
// the ring looks at the least fill of that second; what is more than the margin is only delay and is
// cut out with a cross-fade, small rests by reading up to 0.5 % faster or slower (inaudible), so that
// two clocks that differ never run it empty or full. Running dry widens the margin, calm narrows it.

const LENGTH = 48000;
const MARGINS_S = [0.02, 0.15];
const CALM_S = 3; // without running dry: then the margin narrows by a seventh
const JUMP_S = 0.012; // less than this is left to the speed

class Ring extends AudioWorkletProcessor {
  constructor() {
    super();
    this.left = new Float32Array(LENGTH);
    this.right = new Float32Array(LENGTH);
    this.written = 0; // samples since the start
    this.read = 0; // fractional
    this.rate = sampleRate;
    this.margin = MARGINS_S[0];
    this.speed = 1;
    this.jump = 0;
    this.playing = false;
    this.least = Infinity;
    this.starved = this.packets = this.packet = this.level = this.blocks = this.calm = 0;
    this.stampOfWritten = 0;
    this.begun = currentTime;
    this.port.onmessage = ({ data }) => { // the port from which the samples come
      data.onmessage = (event) => this.take(event.data);
    };
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
    if (this.written - this.read > 0.6 * LENGTH) this.read = this.written - this.wanted();
  }

  // Fill to begin with: the margin, and the packet that is being played while the next is on its way.
  wanted() {
    return this.margin * this.rate + this.packet;
  }

  // Once a second: how much of the fill was never needed?
  review() {
    const extra = this.least - this.margin * this.rate;
    this.least = Infinity;
    this.jump = extra > JUMP_S * this.rate ? extra : 0;
    this.speed = 1 + Math.min(Math.max(extra / this.rate, -0.005), 0.005);
    if (++this.calm >= CALM_S) {
      this.margin = Math.max(this.margin * 0.86, MARGINS_S[0]);
      this.calm = 0;
    }
  }

  at(ring, position) {
    const whole = Math.floor(position);
    const part = position - whole;
    return ring[whole % LENGTH] * (1 - part) + ring[(whole + 1) % LENGTH] * part;
  }

  process(_, [output]) {
    const [left, right] = output;
    const frames = left.length;
    const fill = this.written - this.read;
    if (!this.playing && this.packets && fill >= this.wanted()) {
      this.playing = true;
      this.read = this.written - this.wanted(); // what has come too late is not made up for
      this.least = Infinity;
      this.reviewAt = currentTime + 1;
    }
    if (this.playing && fill < frames * 2 + this.jump) {
      this.jump = 0;
      if (fill < frames * 2) {
        this.playing = false;
        this.starved++;
        this.calm = 0;
        // A page that has just been opened is busy with itself: that says nothing of the network.
        if (currentTime - this.begun > CALM_S) this.margin = Math.min(this.margin * 1.5, MARGINS_S[1]);
      }
    }
    if (this.playing) {
      this.least = Math.min(this.least, fill - frames);
      const step = (this.rate / sampleRate) * this.speed;
      for (let i = 0; i < frames; i++) {
        let [l, r] = [this.at(this.left, this.read), this.at(this.right, this.read)];
        if (this.jump) {
          const k = (i + 1) / frames;
          l += k * (this.at(this.left, this.read + this.jump) - l);
          r += k * (this.at(this.right, this.read + this.jump) - r);
        }
        left[i] = l;
        if (right) right[i] = r;
        this.level = Math.max(this.level, Math.abs(l), Math.abs(r));
        this.read += step;
      }
      this.read += this.jump;
      this.jump = 0;
      if (currentTime >= this.reviewAt) {
        this.reviewAt = currentTime + 1;
        this.review();
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
