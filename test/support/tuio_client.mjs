// SPDX-License-Identifier: Apache-2.0
// Follows the blocks by TUIO 1.1 or 2.0 with the library tuio-client, over UDP with osc-js:
//     node tuio_client.mjs NODE_MODULES 1|2
// Prints its port, then after each frame what the library holds: [session, id, x, y, angle, vx].
import dgram from 'node:dgram';
import {createRequire} from 'node:module';

const [folder, version] = process.argv.slice(2);
const OSC = createRequire(`${folder}/`)('osc-js');
const tuio = await import(`${folder}/tuio-client/dist/tuio-client.es.js`);

class Receiver extends tuio.TuioReceiver {
    connect() {
        const osc = new OSC({discardLateMessages: false, plugin: {registerNotify() {}, status() {}}});
        osc.on('*', message => this.onOscMessage(message));
        const socket = dgram.createSocket('udp4');
        socket.on('message', data => osc.eventHandler.notify(new Uint8Array(data)));
        socket.bind(0, '127.0.0.1', () => console.log(socket.address().port));
    }
    disconnect() {}
}

const receiver = new Receiver();
const tokens = new Map();
const row = (one, id) => [one.sessionId, id, one.position.x, one.position.y, one.angle, one.velocity.x];
const tell = rows => console.log(JSON.stringify(rows));
const no = () => {};
if (version === '1') {
    const client = new tuio.Tuio11Client(receiver);
    client.addTuioListener({
        addTuioObject: no, updateTuioObject: no, removeTuioObject: no,
        addTuioCursor: no, updateTuioCursor: no, removeTuioCursor: no,
        addTuioBlob: no, updateTuioBlob: no, removeTuioBlob: no,
        refresh: () => tell([...client.getTuioObjects()].map(one => row(one, one.symbolId))),
    });
    client.connect();
} else {
    const client = new tuio.Tuio20Client(receiver);
    client.addTuioListener({
        tuioAdd: one => tokens.set(one.sessionId, one),
        tuioUpdate: one => tokens.set(one.sessionId, one),
        tuioRemove: one => tokens.delete(one.sessionId),
        tuioRefresh: () => tell([...tokens.values()].map(one => row(one.token, one.token.cId))),
    });
    client.connect();
}
