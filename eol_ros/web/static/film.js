// SPDX-License-Identifier: Apache-2.0
// Pictures that move: a video or an animated GIF, of which the image of now can be drawn. Both have
// `image` with its `width` and `height` once they are `ready`, and tell when that changes. A place in
// them is a share of their length.

const VIDEO = /\.(mp4|webm|gif)(?:#(\d+))?$/i; // and behind # where in it, in % of its length

export const moves = (name) => VIDEO.test(name);
export const source = (name) => (moves(name) ? name.replace(/#\d+$/, '') : name);
export const place = (name) => Number(VIDEO.exec(name)?.[2] ?? 0) / 100;

// told: {ready: an image of where it was sent is there, image: the next one while it plays, failed}.
export const film = (url, told) => (/\.gif$/i.test(url) ? new Gif(url, told) : new Video(url, told));

const NEAR_S = 0.02; // a place is reached

class Video {
  constructor(url, told) {
    const video = (this.image = document.createElement('video'));
    this.told = told;
    this.ready = false;
    video.muted = true;
    video.playsInline = true;
    video.disableRemotePlayback = true;
    video.preload = 'auto';
    video.onloadeddata = () => {
      this.ready = true;
      told.ready();
    };
    video.onseeked = () => told.ready();
    video.onerror = () => told.failed();
    video.src = url;
  }

  get width() {
    return this.image.videoWidth;
  }

  get height() {
    return this.image.videoHeight;
  }

  time(share) {
    const { duration } = this.image; // its last image begins a little before its end
    return Number.isFinite(duration) ? Math.max(Math.min(share * duration, duration - 0.05), 0) : 0;
  }

  stands(share) {
    return this.ready && !this.image.seeking && Math.abs(this.image.currentTime - this.time(share)) < NEAR_S;
  }

  seek(share) {
    this.image.pause();
    if (!this.stands(share) && !this.image.seeking) this.image.currentTime = this.time(share);
  }

  // Play from where it is: round and round, to its end, or to a place that is not passed yet.
  play(loop, share = 1) {
    this.image.loop = loop;
    this.until = share < 1 ? this.time(share) : Infinity;
    if (this.image.currentTime >= this.until - NEAR_S || (this.image.ended && !loop)) return;
    this.image.play().catch(() => {}); // it was held, or let go, before it had begun
    this.watch();
  }

  restart() {
    this.image.currentTime = 0;
  }

  hold() {
    this.image.pause();
  }

  watch() {
    if (this.watching) return;
    this.watching = true;
    this.image.requestVideoFrameCallback((_, { mediaTime }) => {
      this.watching = false;
      if (mediaTime >= this.until - NEAR_S) this.image.pause();
      this.told.image();
      if (!this.image.paused && !this.image.ended) this.watch();
    });
  }

  close() {
    this.told = { ready() {}, image() {}, failed() {} };
    this.image.removeAttribute('src');
    this.image.load(); // its decoder and what it had read ahead go now, not when memory is swept
  }
}

// A canvas shows the first image of a GIF only, so its images are decoded here, one at a time. Where
// the browser has no ImageDecoder (pages without HTTPS from another machine) that one stands still.
class Gif {
  constructor(url, told) {
    this.told = told;
    this.ready = false;
    this.count = 1;
    this.index = 0;
    this.open(url).catch(() => this.told.failed());
  }

  async open(url) {
    if (!window.ImageDecoder) {
      const image = new Image();
      image.src = url;
      await image.decode();
      this.take(image, image.naturalWidth, image.naturalHeight);
      this.told.ready();
      return;
    }
    const answer = await fetch(url);
    if (!answer.ok) throw new Error(url);
    this.decoder = new ImageDecoder({ data: answer.body, type: 'image/gif' });
    await this.decoder.completed;
    this.count = this.decoder.tracks.selectedTrack.frameCount;
    await this.show(0);
    this.told.ready();
  }

  take(image, width, height) {
    this.image?.close?.();
    [this.image, this.width, this.height, this.ready] = [image, width, height, true];
  }

  async show(index) {
    const { image } = await this.decoder.decode({ frameIndex: index });
    this.index = index;
    this.take(image, image.displayWidth, image.displayHeight);
  }

  at(share) {
    return Math.round(share * (this.count - 1));
  }

  stands(share) {
    return this.ready && this.index === this.at(share);
  }

  seek(share) {
    this.hold();
    if (this.decoder && !this.stands(share)) this.show(this.at(share)).then(() => this.told.ready(), () => {});
  }

  play(loop, share = 1) {
    this.loop = loop;
    this.until = this.at(share);
    if (!this.timer && this.decoder) this.wait();
  }

  restart() {
    this.index = -1;
  }

  wait() {
    if (this.index >= this.until && !this.loop) return;
    const shown_ms = (this.image.duration ?? 100000) / 1000;
    this.timer = setTimeout(async () => {
      try {
        await this.show((this.index + 1) % this.count);
      } catch {
        return; // it was let go
      }
      this.told.image();
      if (this.timer) this.wait();
    }, shown_ms);
  }

  hold() {
    clearTimeout(this.timer);
    this.timer = 0;
  }

  close() {
    this.told = { ready() {}, image() {}, failed() {} };
    this.hold();
    this.decoder?.close();
    this.image?.close?.();
  }
}
