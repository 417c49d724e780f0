// SPDX-License-Identifier: Apache-2.0
// A master that nobody here wrote (npm's canopen), on slcan over TCP: node master.js [HOST:]PORT EDS
'use strict';

const assert = require('node:assert');
const net = require('node:net');
const { Device, DataType, Eds, LssMode, NmtState, SdoCode } = require('canopen');

const DRIVE = 1, MASTER = 0x20, UNCONFIGURED = 255, Y = 0x800;
const CYCLE_MS = 10;
const { UNSIGNED8: U8, UNSIGNED16: U16, UNSIGNED32: U32, INTEGER8: I8, INTEGER32: I32 } = DataType;
const { VISIBLE_STRING: STRING } = DataType;

const sleep = (ms) => new Promise((done) => setTimeout(done, ms));

/** Call `connected` with frames and a function that sends them: slcan's tXXXLDD.. and rXXXL. */
function slcan(host, port, onMessage) {
    const socket = net.connect(port, host).setNoDelay(true);
    let rest = '';
    socket.on('data', (chunk) => {
        const lines = (rest + chunk.toString('latin1')).split(/[\r\n\x07]/);
        rest = lines.pop();
        for (const line of lines.filter((text) => text[0] === 't')) {
            onMessage({ id: parseInt(line.slice(1, 4), 16), data: Buffer.from(line.slice(5), 'hex') });
        }
    });
    socket.write('C\rS8\rO\r');
    const send = ({ id, data, rtr }) => {
        const bytes = Buffer.from(data || []);
        const head = (rtr ? 'r' : 't') + id.toString(16).padStart(3, '0') + bytes.length;
        socket.write(`${head}${rtr ? '' : bytes.toString('hex')}\r`);
    };
    return { send, close: () => socket.end() };
}

class Drive {
    constructor(device) {
        this.device = device;
        this.emergencies = [];
        device.emcy.on('emergency', ({ em }) => this.emergencies.push(em.code));
    }

    read(index, subIndex, dataType, blockTransfer = false) {
        return this.device.sdo.upload({ deviceId: DRIVE, index, subIndex, dataType, blockTransfer, timeout: 500 });
    }

    write(index, subIndex, dataType, data) {
        return this.device.sdo.download({ deviceId: DRIVE, index, subIndex, dataType, data, timeout: 500 });
    }

    async until(what, condition, ms = 5000) {
        for (const end = Date.now() + ms; !(await condition()); await sleep(2)) {
            if (Date.now() < end) continue;
            const words = [await this.status(0), await this.status(Y)].map((word) => word.toString(16));
            throw new Error(`not within ${ms} ms: ${what}; statuswords ${words}`);
        }
    }

    status(axis) {
        return this.read(0x6041 + axis, 0, U16);
    }

    async bits(axis, mask, value, what) {
        await this.until(what, async () => ((await this.status(axis)) & mask) === value);
    }

    async enable(axis) {
        await this.write(0x6040 + axis, 0, U16, 0x80);
        for (const [word, state] of [[6, 0x21], [7, 0x23], [15, 0x27]]) {
            await this.until(`state ${state.toString(16)}h`, async () => { // commands come each cycle, as of a PLC
                await this.write(0x6040 + axis, 0, U16, word);
                return ((await this.status(axis)) & 0x6f) === state;
            });
        }
    }

    async map(communication, mapping, cobId, entries, type) {
        await this.write(communication, 1, U32, (cobId | 0x80000000) >>> 0);
        await this.write(mapping, 0, U8, 0);
        for (const [i, entry] of entries.entries()) await this.write(mapping, i + 1, U32, entry);
        await this.write(mapping, 0, U8, entries.length);
        await this.write(communication, 2, U8, type);
        await this.write(communication, 1, U32, cobId);
    }
}

const steps = {
    async 'the EDS and SDO: expedited, segmented, block, abort'(drive, eds) {
        assert.strictEqual(await drive.read(0x1000, 0, U32), eds.getEntry(0x1000).value);
        assert.strictEqual(await drive.read(0x1008, 0, STRING), 'Kontur');
        assert.strictEqual(await drive.read(0x1008, 0, STRING, true), 'Kontur');
        await assert.rejects(drive.read(0x5000, 0, U8), { code: SdoCode.OBJECT_UNDEFINED });
        await assert.rejects(drive.write(0x6060, 0, I8, 4), { code: SdoCode.BAD_VALUE });
    },

    async 'LSS: fastscan of a node without an id'(drive) {
        const { lss } = drive.device;
        lss.switchModeGlobal(LssMode.CONFIGURATION);
        await lss.configureNodeId(UNCONFIGURED, 500);
        lss.switchModeGlobal(LssMode.OPERATION);
        drive.device.nmt.resetCommunication(DRIVE);
        await sleep(200);
        const found = await lss.fastscan({ timeout: 200 });
        assert.strictEqual(found.productCode, 1);
        await lss.configureNodeId(DRIVE, 500);
        lss.switchModeGlobal(LssMode.OPERATION);
        await drive.until('boot-up', () => drive.read(0x1000, 0, U32).then(() => true, () => false));
    },

    async 'NMT and heartbeat'(drive) {
        const { nmt } = drive.device;
        for (const [command, state] of [['startNode', NmtState.OPERATIONAL], ['stopNode', NmtState.STOPPED],
            ['enterPreOperational', NmtState.PRE_OPERATIONAL], ['startNode', NmtState.OPERATIONAL]]) {
            nmt[command](DRIVE);
            await drive.until(`${command}`, async () => (await nmt.getNodeState(DRIVE, 1000)) === state);
        }
    },

    async 'profile position'(drive) {
        for (const [axis, target] of [[0, 2000000], [Y, -1000000]]) {
            await drive.write(0x6060 + axis, 0, I8, 1);
            await drive.write(0x6081 + axis, 0, U32, 20000);
            await drive.write(0x607a + axis, 0, I32, target);
            await drive.enable(axis);
            await drive.write(0x6040 + axis, 0, U16, 0x1f);
            await drive.bits(axis, 0x1000, 0x1000, 'set-point acknowledged');
            await drive.write(0x6040 + axis, 0, U16, 0x0f);
            await drive.bits(axis, 0x0400, 0x0400, 'target reached');
            assert(Math.abs(await drive.read(0x6064 + axis, 0, I32) - target) < 5000);
        }
    },

    async 'a controlword of 0 by RPDO stops a jog'(drive) {
        await drive.write(0x6060, 0, I8, 3);
        await drive.write(0x60ff, 0, I32, -20000);
        await drive.until('jog', async () => await drive.read(0x606c, 0, I32) < -10000);
        drive.device.eds.getEntry(0x3000).value = 0;
        drive.device.pdo.write(0x200 + DRIVE);
        await drive.bits(0, 0x6f, 0x40, 'switch on disabled');
    },

    async 'cyclic synchronous position by SYNC each 10 ms'(drive) {
        const { device } = drive, { nmt } = device;
        nmt.enterPreOperational(DRIVE);
        await drive.map(0x1401, 0x1601, 0x300 + DRIVE, [0x607a0020, 0x687a0020], 1);
        await drive.map(0x1801, 0x1a01, 0x280 + DRIVE, [0x60640020, 0x68640020], 1);
        nmt.startNode(DRIVE);
        const start = [];
        for (const axis of [0, Y]) {
            await drive.until('standstill', async () => Math.abs(await drive.read(0x606c + axis, 0, I32)) < 500);
            await drive.write(0x6060 + axis, 0, I8, 8);
            await drive.write(0x60c2 + axis, 1, U8, CYCLE_MS);
            start.push(await drive.read(0x6064 + axis, 0, I32));
        }
        let actual = null, begin = null, farthest = 0, late = 0, last = null;
        device.pdo.on('pdo', ({ cobId, dataObjects }) => {
            if (cobId === 0x280 + DRIVE) actual = dataObjects.map((object) => object.value);
        });
        const radius = 2e6, lap = 100; // nm, cycles
        const started = performance.now();
        const cycle = () => { // the number of this SYNC goes by the clock, as its set-points do
            const number = Math.round((performance.now() - started) / CYCLE_MS);
            if (last !== null) late += number > last + 1 ? 1 : 0;
            last = number;
            const laps = begin === null ? 0 : Math.min((number - begin) / lap, 2);
            const ramp = Math.sin(Math.PI / 2 * Math.min(1, laps)) ** 2, angle = 2 * Math.PI * laps;
            device.eds.getEntry(0x3001).value = Math.round(start[0] + radius * ramp * (Math.cos(angle) - 1));
            device.eds.getEntry(0x3002).value = Math.round(start[1] + radius * ramp * Math.sin(angle));
            device.pdo.write(0x300 + DRIVE);
            device.sync.write();
            if (actual) farthest = Math.max(farthest, Math.abs(actual[0] - start[0]));
            timer = setTimeout(cycle, started + (number + 1) * CYCLE_MS - performance.now());
        };
        let timer = setTimeout(cycle, CYCLE_MS);
        try {
            for (const axis of [0, Y]) await drive.enable(axis);
            for (const axis of [0, Y]) await drive.bits(axis, 0x1000, 0x1000, 'follows');
            begin = last + 10;
            await drive.until('the circle', () => last > begin + 2 * lap + 20, 20000);
            assert(Math.abs(farthest - 2 * radius) < 1e5, `went ${farthest} nm; ${late} cycles were left out`);
            for (const axis of [0, Y]) {
                assert.strictEqual((await drive.status(axis)) & 0x6f, 0x27);
                await drive.write(0x6040 + axis, 0, U16, 0);
            }
        } finally {
            clearTimeout(timer);
        }
    },
};

async function main(address, edsFile) {
    const [port, host = '127.0.0.1'] = address.split(':').reverse();
    const eds = Eds.fromFile(edsFile);
    const device = new Device({ id: MASTER, enableLss: true });
    const bus = slcan(host, Number(port), (message) => device.receive(message));
    device.addListener('message', (message) => bus.send(message));
    device.eds.addSdoClientParameter(DRIVE, 0x600 + DRIVE, 0x580 + DRIVE);
    device.eds.addEmcyConsumer(0x80 + DRIVE);
    device.eds.setSyncCobId(0x80);
    device.eds.setSyncGenerationEnable(true);
    const objects = [[0x3000, U32], [0x3001, I32], [0x3002, I32], [0x3003, I32], [0x3004, I32]].map(
        ([index, dataType]) => device.eds.addEntry(index, { parameterName: `of the drive ${index}`, dataType }));
    device.eds.addTransmitPdo({ cobId: 0x200 + DRIVE, transmissionType: 254, dataObjects: objects.slice(0, 1) });
    device.eds.addTransmitPdo({ cobId: 0x300 + DRIVE, transmissionType: 254, dataObjects: objects.slice(1, 3) });
    device.eds.addReceivePdo({ cobId: 0x280 + DRIVE, dataObjects: objects.slice(3) });
    device.eds.addHeartbeatConsumer(DRIVE, 300);
    device.start();
    device.nmt.startNode(); // itself
    const drive = new Drive(device);
    let failed = 0;
    for (const [name, step] of Object.entries(steps)) {
        try {
            await step(drive, eds);
            console.log(`ok      ${name}`);
        } catch (error) {
            failed += 1;
            console.log(`FAILED  ${name}: ${error.stack}`);
        }
    }
    console.log(`EMCY    ${drive.emergencies.map((code) => code.toString(16)).join(' ') || 'none'}`);
    device.stop();
    bus.close();
    process.exitCode = failed ? 1 : 0;
}

main(...process.argv.slice(2));
