/* SPDX-License-Identifier: Apache-2.0
 *
 * One block in emulation, for the tests: simavr runs the firmware, instruction by instruction, and
 * here is what it is wired to: an LIS3DH on I2C that is given samples, an nRF24L01+ on SPI whose
 * frames come and go, the LEDs, a battery. eol_ros/devices/board/firmware.py loads it with ctypes.
 *
 * Each says only what its data sheet says it would to this firmware; what it does not know it counts
 * in `strange`. Where libsimavr is quicker on I2C than the bit rate that was set, the rest is waited.
 */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <simavr/avr_adc.h>
#include <simavr/avr_eeprom.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_twi.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_irq.h>

#include "../link.h"
#include "radio.h"

enum { HZ = 8000000, FIFO = 32, EVENTS = 4096, PATTERN = 0xA5, SMCR = 0x53, PORTD = 0x2B, TCCR0A = 0x44, OCR0A = 0x47, SPCR = 0x4C, SPSR, SPDR, TWBR = 0xB8, TWSR, TWCR = 0xBC };
enum { L_ACTIVE, L_IDLE, L_POWER_DOWN, L_LISTENING, L_SENDING, L_SENSOR_FAST, L_SENSOR_SLOW, L_INFRARED, L_WHITE, LOADS };
enum { E_LEVEL = 1, E_INFRARED, E_SENT };
enum { STIFF = 1, WHITE_OPEN = 2, INFRARED_OPEN = 4, WHITE_STAYS = 8 }; /* parts that are broken */

typedef struct {
    uint64_t cycle;
    uint32_t what, value;
    uint8_t frame[EOL_FRAME];
    uint8_t pad[6];
} event;

typedef struct {
    avr_t *avr;
    /* accelerometer */
    uint8_t reg[64], at, addressed, address, first_byte;
    int16_t fifo[FIFO][2];
    int fifo_begin, fifo_count;
    const int16_t *samples;
    uint64_t sample_count, sample_next;
    double sample_first, sample_period;
    uint64_t read, lost; /* samples */
    int dead_bus, motion, settled, skipped, broken;
    int16_t last[2]; /* sample, where it is not kept in the FIFO */
    uint8_t fresh;
    double mean[2]; /* of its high-pass */
    avr_io_write_t twcr; /* what libsimavr does where it is written to */
    void *twcr_param;
    radio radio;
    uint8_t spi;
    int acks;
    uint64_t answer; /* ns: when an acknowledgement has come; 0: none will */
    uint64_t said_at; /* on I2C */
    uint64_t asleep, power_down, strange, resets;
    uint64_t loads[LOADS]; /* cycles in which each of them drew current */
    uint8_t level, infrared, driven;
    event events[EVENTS];
    int event_count;
} emulator;

static void note(emulator *e, uint32_t what, uint32_t value)
{
    if (e->event_count == EVENTS) return;
    event *to = &e->events[e->event_count++];
    memset(to, 0, sizeof *to);
    to->cycle = e->avr->cycle;
    to->what = what;
    to->value = value;
}

/* A pin of port D is driven from outside; what the firmware writes to the port does not change it. */
static void pin(emulator *e, int number, int high)
{
    e->driven = (uint8_t)(high ? e->driven | 1 << number : e->driven & ~(1 << number));
    avr_ioport_external_t outside = {.name = 'D', .mask = 1 << 2 | 1 << 3, .value = e->driven};
    avr_ioctl(e->avr, AVR_IOCTL_IOPORT_SET_EXTERNAL('D'), &outside);
    avr_raise_irq(avr_io_getirq(e->avr, AVR_IOCTL_IOPORT_GETIRQ('D'), number), high);
}

/* ---- LIS3DH */

enum { CTRL1 = 0x20, CTRL2, CTRL3, CTRL4, CTRL5, FIFO_CTRL = 0x2E, INT1_CFG = 0x30, INT1_THS = 0x32 };

static void sensor_pin(emulator *e)
{
    int has = e->fifo_count > (e->reg[FIFO_CTRL] & 31);
    pin(e, 2, (e->reg[CTRL3] & 0x04 && has) || (e->reg[CTRL3] & 0x40 && e->motion));
}

static void sensor_sample(emulator *e, int16_t x, int16_t y)
{
    uint8_t rate = e->reg[CTRL1] >> 4;
    if (rate == 9 && e->reg[CTRL5] & 0x40 && e->reg[FIFO_CTRL] >> 6 == 2) {
        if (e->fifo_count == FIFO) {
            e->fifo_begin = (e->fifo_begin + 1) % FIFO;
            e->fifo_count--;
            e->lost++;
        }
        int to = (e->fifo_begin + e->fifo_count++) % FIFO;
        e->fifo[to][0] = x;
        e->fifo[to][1] = y;
    } else if (rate == 9) {
        e->last[0] = x;
        e->last[1] = y;
        e->fresh = 1;
    } else if (rate == 5 && ++e->skipped >= 13) { /* 100 of 1344, less their mean: a fiftieth of 100 Hz */
        const int16_t raw[2] = {x, y};
        e->skipped = e->motion = 0;
        for (int axis = 0; axis < 2; axis++) {
            if (!e->settled) e->mean[axis] = raw[axis];
            e->motion |= fabs(raw[axis] - e->mean[axis]) > e->reg[INT1_THS] * 256;
            e->mean[axis] += (raw[axis] - e->mean[axis]) * 0.126;
        }
        e->settled = 1;
    }
    sensor_pin(e);
}

static uint8_t sensor_byte(emulator *e)
{
    uint8_t at = e->at & 0x7F, value = at < 64 ? e->reg[at] : 0;
    if (at == 0x0F) value = 0x33;
    if (at == 0x27) value = e->fresh ? 0x0F : 0;
    if (at >= 0x28 && at <= 0x2D) {
        int16_t raw[3] = {0, 0, 16384};
        memcpy(raw, e->fifo_count ? e->fifo[e->fifo_begin] : e->reg[FIFO_CTRL] >> 6 ? raw : e->last, sizeof e->last);
        if ((e->reg[CTRL4] >> 1 & 3) == 1 && !(e->broken & STIFF)) { /* its own force: 300, 340, 500 mg */
            static const int16_t PULLS[3] = {300 * 16, 340 * 16, 500 * 16};
            for (int k = 0; k < 3; k++) raw[k] = (int16_t)(raw[k] + PULLS[k]);
        }
        if (at == 0x2D) e->fresh = 0;
        value = (uint8_t)((uint16_t)raw[(at - 0x28) / 2] >> 8 * (at & 1));
        if (at == 0x2D && e->fifo_count) {
            e->fifo_begin = (e->fifo_begin + 1) % FIFO;
            e->fifo_count--;
            e->read++;
            sensor_pin(e);
        }
    } else if (at == 0x2F) {
        value = (uint8_t)(e->fifo_count | (e->fifo_count ? 0 : 0x20));
    }
    if (e->at & 0x80) e->at = at == 0x2D ? 0x80 | 0x28 : e->at + 1;
    return value;
}

static void on_twi(struct avr_irq_t *irq, uint32_t value, void *param)
{
    emulator *e = param;
    avr_twi_msg_irq_t m = {.u.v = value};
    avr_irq_t *in = avr_io_getirq(e->avr, AVR_IOCTL_TWI_GETIRQ(0), TWI_IRQ_INPUT);
    (void)irq;
    if (e->dead_bus) return;
    e->said_at = e->avr->cycle;
    if (m.u.twi.msg & TWI_COND_STOP) e->addressed = 0;
    if (m.u.twi.msg & TWI_COND_START) {
        e->addressed = m.u.twi.addr >> 1 == 0x18;
        e->first_byte = e->address = !(m.u.twi.addr & 1);
        if (e->addressed) avr_raise_irq(in, avr_twi_irq_msg(TWI_COND_ACK, m.u.twi.addr, 1));
        else e->strange++;
        return;
    }
    if (!e->addressed) return;
    if (m.u.twi.msg & TWI_COND_WRITE) {
        avr_raise_irq(in, avr_twi_irq_msg(TWI_COND_ACK, m.u.twi.addr, 1));
        if (e->first_byte) {
            e->at = m.u.twi.data;
            e->first_byte = 0;
        } else if ((e->at & 0x7F) < 64) {
            e->reg[e->at & 0x7F] = m.u.twi.data;
            if (e->at == CTRL1 || (e->at == FIFO_CTRL && m.u.twi.data >> 6 == 0)) e->fifo_count = e->motion = e->settled = 0;
            sensor_pin(e);
        }
    } else if (m.u.twi.msg & TWI_COND_READ) {
        avr_raise_irq(in, avr_twi_irq_msg(TWI_COND_READ, m.u.twi.addr, sensor_byte(e)));
    }
}

/* Writing TWINT clears it; libsimavr 1.6 leaves it, which only who waits by interrupt does not notice. */
static void on_twcr(avr_t *avr, avr_io_addr_t at, uint8_t value, void *param)
{
    emulator *e = param;
    e->twcr(avr, at, value, e->twcr_param);
    if (value & 0x80) avr->data[at] &= 0x7F;
}

/* A byte takes nine bits of the rate that was set, a start one. */
static void on_twi_status(struct avr_irq_t *irq, uint32_t value, void *param)
{
    emulator *e = param;
    uint64_t bit = 16 + 2 * (uint64_t)e->avr->data[TWBR], took = e->avr->cycle - e->said_at;
    uint64_t right = value == 0x08 || value == 0x10 ? bit : value == 0xF8 ? 0 : 9 * bit;
    (void)irq;
    if (value == 0x28 && e->address) /* simavr 1.6 says that of an address, too */
        e->avr->data[TWSR] = (uint8_t)((e->avr->data[TWSR] & 7) | 0x18);
    e->address = 0;
    if (value == 0x08 || value == 0x10) took = 0;
    if (took < right && e->said_at) e->avr->cycle += right - took;
}

/* ---- nRF24L01+ */

enum { CYCLE_NS = 1000000000 / HZ, ANSWER_NS = 203000 /* 130 us, and 73 us in the air */ };

static uint64_t now_ns(const emulator *e)
{
    return e->avr->cycle * CYCLE_NS;
}

static void radio_pin(emulator *e)
{
    pin(e, 3, radio_irq(&e->radio));
}

/* SPI by its registers: libsimavr 1.6 has a byte take 100 us, whatever its clock is. */
static void on_spdr_write(avr_t *avr, avr_io_addr_t at, uint8_t value, void *param)
{
    static const uint16_t DIVIDER[4] = {4, 16, 64, 128};
    emulator *e = param;
    (void)at;
    if (!(avr->data[SPCR] & 0x40)) return;
    e->spi = radio_byte(&e->radio, value, now_ns(e));
    radio_pin(e);
    avr->cycle += 8 * DIVIDER[avr->data[SPCR] & 3];
    avr->data[SPSR] |= 0x80;
}

static uint8_t on_spdr_read(avr_t *avr, avr_io_addr_t at, void *param)
{
    (void)at;
    avr->data[SPSR] &= 0x7F;
    return ((emulator *)param)->spi;
}

static void on_csn(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    radio_csn(&((emulator *)param)->radio, value & 1);
}

static void on_ce(struct avr_irq_t *irq, uint32_t value, void *param)
{
    emulator *e = param;
    (void)irq;
    radio_ce(&e->radio, value & 1, now_ns(e));
}

static void advance_radio(emulator *e)
{
    if (e->radio.phase == RADIO_RESTS || now_ns(e) < e->radio.phase_ends_ns) return;
    radio_advance(&e->radio, now_ns(e));
    if (e->radio.was_sent) {
        e->radio.was_sent = 0;
        note(e, E_SENT, (uint32_t)e->acks);
        memcpy(e->events[e->event_count - 1].frame, e->radio.sent.bytes, EOL_FRAME);
        if (e->acks) e->answer = now_ns(e) + ANSWER_NS;
    }
    radio_pin(e);
}

static void take_answer(emulator *e)
{
    if (!e->answer || now_ns(e) < e->answer) return;
    e->answer = 0;
    radio_acknowledged(&e->radio, now_ns(e));
    radio_pin(e);
}

/* ---- the rest of the block */

/* 0..255: pulsed by the timer, or as the pin of port D stands. */
static uint8_t white(const emulator *e)
{
    return e->avr->data[TCCR0A] ? e->avr->data[OCR0A] : e->avr->data[PORTD] & 0x40 ? 255 : 0;
}

/* What has drawn current in the last `cycles`; L_WHITE in 1/255 of them. */
static void load(emulator *e, uint64_t cycles, int asleep, uint8_t mode)
{
    uint8_t rate = e->reg[CTRL1] >> 4;
    e->loads[!asleep ? L_ACTIVE : mode == 0x04 ? L_POWER_DOWN : L_IDLE] += cycles;
    if (e->radio.phase == RADIO_SENDS) e->loads[L_SENDING] += cycles;
    else if (e->radio.listens_ns != UINT64_MAX || e->radio.phase == RADIO_WAITS) e->loads[L_LISTENING] += cycles;
    if (rate == 9) e->loads[L_SENSOR_FAST] += cycles;
    if (rate == 5) e->loads[L_SENSOR_SLOW] += cycles;
    if (e->infrared) e->loads[L_INFRARED] += cycles;
    e->loads[L_WHITE] += cycles * e->level;
}

static void on_infrared(struct avr_irq_t *irq, uint32_t value, void *param)
{
    emulator *e = param;
    (void)irq;
    e->infrared = value & 1;
    note(e, E_INFRARED, value & 1);
}

/* Before each conversion: what the dividers make of the LEDs' voltages, mV. */
static void on_adc(struct avr_irq_t *irq, uint32_t value, void *param)
{
    emulator *e = param;
    uint8_t port = e->avr->data[PORTD];
    int lit = port & 1 << 6 && !(e->broken & WHITE_STAYS), shines = port & 1 << 5;
    uint32_t white = lit ? 100 : e->broken & WHITE_OPEN ? 0 : 3700 - 2200;
    uint32_t infrared = !shines ? 0 : e->broken & INFRARED_OPEN ? 3300 : 1350;
    (void)irq;
    (void)value;
    avr_raise_irq(avr_io_getirq(e->avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC1), white / 4);
    avr_raise_irq(avr_io_getirq(e->avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC2), infrared / 4);
}

static void no_sleep(avr_t *avr, avr_cycle_count_t how_long)
{
    (void)avr;
    (void)how_long;
}

static void no_log(avr_t *avr, const int level, const char *format, va_list words)
{
    (void)avr;
    (void)level;
    (void)format;
    (void)words;
}

static void listen(emulator *e, uint32_t port, int number, avr_irq_notify_t to)
{
    avr_irq_register_notify(avr_io_getirq(e->avr, port, number), to, e);
}

int emulator_hears(emulator *e, const radio_packet *packet);

emulator *emulator_new(uint8_t *code, uint32_t size, uint8_t block)
{
    emulator *e = calloc(1, sizeof *e);
    avr_eeprom_desc_t rom = {.ee = &block, .offset = 0, .size = 1};
    avr_global_logger_set(no_log);
    e->avr = avr_make_mcu_by_name("atmega328p");
    if (!e->avr) return NULL;
    avr_init(e->avr);
    e->avr->frequency = HZ;
    e->avr->vcc = e->avr->avcc = 3300;
    e->avr->log = LOG_NONE;
    e->avr->sleep = no_sleep;
    avr_loadcode(e->avr, code, size, 0);
    e->avr->codeend = e->avr->flashend;
    avr_ioctl(e->avr, AVR_IOCTL_EEPROM_SET, &rom);
    memset(e->avr->data + 0x100, PATTERN, e->avr->ramend - 0xFF);
    e->acks = 1;
    radio_begin(&e->radio);
    e->twcr = e->avr->io[AVR_DATA_TO_IO(TWCR)].w.c;
    e->twcr_param = e->avr->io[AVR_DATA_TO_IO(TWCR)].w.param;
    e->avr->io[AVR_DATA_TO_IO(TWCR)].w.c = on_twcr;
    e->avr->io[AVR_DATA_TO_IO(TWCR)].w.param = e;
    listen(e, AVR_IOCTL_TWI_GETIRQ(0), TWI_IRQ_OUTPUT, on_twi);
    listen(e, AVR_IOCTL_TWI_GETIRQ(0), TWI_IRQ_STATUS, on_twi_status);
    e->avr->io[AVR_DATA_TO_IO(SPDR)].w.c = on_spdr_write;
    e->avr->io[AVR_DATA_TO_IO(SPDR)].r.c = on_spdr_read;
    e->avr->io[AVR_DATA_TO_IO(SPDR)].w.param = e->avr->io[AVR_DATA_TO_IO(SPDR)].r.param = e;
    listen(e, AVR_IOCTL_IOPORT_GETIRQ('B'), 1, on_ce);
    listen(e, AVR_IOCTL_IOPORT_GETIRQ('B'), 2, on_csn);
    listen(e, AVR_IOCTL_IOPORT_GETIRQ('D'), 5, on_infrared);
    listen(e, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_OUT_TRIGGER, on_adc);
    avr_raise_irq(avr_io_getirq(e->avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0), 3700 / 4);
    avr_raise_irq(avr_io_getirq(e->avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_TEMP), 313);
    pin(e, 2, 0);
    pin(e, 3, 1);
    return e;
}

void emulator_free(emulator *e)
{
    avr_terminate(e->avr);
    free(e->avr);
    free(e);
}

/* Samples x, y: the first ends at cycle `first`, the others every `period` cycles. Not copied. */
void emulator_samples(emulator *e, const int16_t *xy, uint64_t count, double first, double period)
{
    e->samples = xy;
    e->sample_count = count;
    e->sample_next = 0;
    e->sample_first = first;
    e->sample_period = period;
}

static uint64_t sooner(uint64_t cycle, uint64_t ns)
{
    uint64_t other = (ns + CYCLE_NS - 1) / CYCLE_NS;
    return ns && other < cycle ? other : cycle;
}

/* Run until `cycle`; returns the state of the core: 2 runs, 3 sleeps, more: it ended. */
int emulator_run(emulator *e, uint64_t cycle)
{
    avr_t *avr = e->avr;
    while (avr->cycle < cycle) {
        uint64_t before = avr->cycle;
        int asleep = avr->state == cpu_Sleeping;
        uint8_t mode = avr->data[SMCR] & 0x0E;
        int state;
        if (asleep) { /* never further than what comes from outside */
            uint64_t next = cycle;
            if (e->sample_next < e->sample_count) {
                double at = ceil(e->sample_first + (double)e->sample_next * e->sample_period);
                if (at < (double)next) next = (uint64_t)at;
            }
            next = sooner(next, e->radio.phase == RADIO_RESTS ? 0 : e->radio.phase_ends_ns);
            next = sooner(next, e->answer);
            avr->run_cycle_limit = next > avr->cycle ? next - avr->cycle : 1;
        } else {
            avr->run_cycle_limit = 1;
        }
        state = avr_run(avr);
        if (asleep && state == cpu_Sleeping) {
            e->asleep += avr->cycle - before;
            if (mode == 0x04) e->power_down += avr->cycle - before;
        }
        load(e, avr->cycle - before, asleep && state == cpu_Sleeping, mode);
        if (state > cpu_Sleeping) return state;
        while (e->sample_next < e->sample_count &&
               (double)avr->cycle >= e->sample_first + (double)e->sample_next * e->sample_period) {
            const int16_t *s = e->samples + 2 * e->sample_next++;
            sensor_sample(e, s[0], s[1]);
        }
        advance_radio(e);
        take_answer(e);
        if (white(e) != e->level) {
            e->level = white(e);
            note(e, E_LEVEL, e->level);
        }
    }
    return avr->state;
}

/* Cycles since the start in which each part of the block drew current; see L_ACTIVE and on. */
void emulator_loads(const emulator *e, uint64_t *to) { memcpy(to, e->loads, sizeof e->loads); }

uint64_t emulator_cycle(const emulator *e) { return e->avr->cycle; }

/* The bridge sends; returns whether the block's radio took it. */
int emulator_radio(emulator *e, const uint8_t *frame)
{
    radio_packet packet = {.address = EOL_TO_BLOCKS, .channel = EOL_CHANNEL, .setup = 0x0C, .size = EOL_FRAME, .unanswered = 1};
    packet.begin_ns = packet.end_ns = now_ns(e);
    memcpy(packet.bytes, frame, EOL_FRAME);
    return emulator_hears(e, &packet);
}

/* A packet has ended that may have begun long before. */
int emulator_hears(emulator *e, const radio_packet *packet)
{
    int took = radio_hears(&e->radio, packet);
    radio_pin(e);
    return took;
}

/* The acknowledgement of what it has sent has come. */
void emulator_answered(emulator *e)
{
    radio_acknowledged(&e->radio, now_ns(e));
    radio_pin(e);
}

/* Break or mend the radio (radio.h: `fault`), or let its supply fail for a moment (-1). */
void emulator_radio_fault(emulator *e, int fault)
{
    if (fault < 0) radio_reset(&e->radio);
    else e->radio.fault = (uint8_t)fault;
    radio_pin(e);
}

void emulator_set(emulator *e, int acks, int dead_bus)
{
    e->acks = acks;
    e->dead_bus = dead_bus;
}

/* Break parts: the sensor's mass sticks, an LED is open, the white one's transistor never lets go of it. */
void emulator_break(emulator *e, int broken) { e->broken = broken; }

/* Jump to an endless loop in flash that nothing uses, with or without interrupts. */
void emulator_hang(emulator *e, int interrupts)
{
    uint32_t at = e->avr->flashend - 1;
    e->avr->flash[at] = 0xFF; /* rjmp to itself */
    e->avr->flash[at + 1] = 0xCF;
    e->avr->pc = at;
    e->avr->state = cpu_Running;
    e->avr->sreg[7] = (uint8_t)interrupts;
}

void emulator_reset(emulator *e) { avr_reset(e->avr); }

/* Take the events since the last call; returns how many, `room` at most. */
int emulator_events(emulator *e, event *to, int room)
{
    int count = e->event_count < room ? e->event_count : room;
    memcpy(to, e->events, sizeof *to * (size_t)count);
    e->event_count = 0;
    return count;
}

/* Counters: cycles asleep, of these powered down, samples read and lost, what was not understood,
 * bytes of RAM that were ever written to, the program counter, whether infrared shines, level of white. */
void emulator_counts(const emulator *e, uint64_t *to)
{
    uint64_t used = 0;
    for (uint32_t at = 0x100; at <= e->avr->ramend; at++) used += e->avr->data[at] != PATTERN;
    to[0] = e->asleep;
    to[1] = e->power_down;
    to[2] = e->read;
    to[3] = e->lost;
    to[4] = e->strange + e->radio.strange;
    to[5] = used;
    to[6] = e->avr->pc;
    to[7] = e->infrared;
    to[8] = e->level;
}

void emulator_memory(const emulator *e, uint32_t at, uint8_t *to, uint32_t count)
{
    memcpy(to, e->avr->data + at, count);
}
