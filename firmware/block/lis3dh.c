/* SPDX-License-Identifier: Apache-2.0 */
#include "lis3dh.h"

#include <avr/io.h>
#include <util/delay.h>
#include <util/twi.h>

enum {
    ADDRESS = 0x18, /* SA0 to ground */
    WHO_AM_I = 0x0F, ITS_NAME = 0x33,
    CTRL_REG1 = 0x20, CTRL_REG2, CTRL_REG3, CTRL_REG4, CTRL_REG5,
    STATUS = 0x27, FRESH = 0x08, OUT_X = 0x28, FIFO_CTRL = 0x2E, INT1_CFG = 0x30, INT1_THS = 0x32, INT1_DURATION,
    ONWARD = 0x80, /* of a register: count up while reading */
    SETTLE_MS = 20, MEAN = 16, /* of a self-test: until it rests, samples of a mean (AN3308, 5) */
    TRIES = 250    /* turns of a loop of 7 cycles: some 220 us, ten times a byte */
};

static uint8_t wait(uint8_t wanted)
{
    for (uint8_t left = TRIES; left; left--)
        if (TWCR & (1 << TWINT)) return (TWSR & TW_STATUS_MASK) == wanted;
    return 0;
}

static uint8_t start(uint8_t wanted)
{
    TWCR = (1 << TWINT) | (1 << TWSTA) | (1 << TWEN);
    return wait(wanted);
}

static uint8_t put(uint8_t byte, uint8_t wanted)
{
    TWDR = byte;
    TWCR = (1 << TWINT) | (1 << TWEN);
    return wait(wanted);
}

static void stop(void)
{
    TWCR = (1 << TWINT) | (1 << TWSTO) | (1 << TWEN);
    for (uint8_t left = TRIES; left && (TWCR & (1 << TWSTO)); left--) {}
}

static uint8_t fail(void)
{
    TWCR = 0; /* lets go of the bus, whatever state it was in */
    return 0;
}

static uint8_t write(uint8_t reg, uint8_t value)
{
    if (!start(TW_START) || !put(ADDRESS << 1 | TW_WRITE, TW_MT_SLA_ACK) || !put(reg, TW_MT_DATA_ACK) ||
        !put(value, TW_MT_DATA_ACK))
        return fail();
    stop();
    return 1;
}

static uint8_t read(uint8_t reg, uint8_t *to, uint8_t count)
{
    if (!start(TW_START) || !put(ADDRESS << 1 | TW_WRITE, TW_MT_SLA_ACK) || !put(reg, TW_MT_DATA_ACK) ||
        !start(TW_REP_START) || !put(ADDRESS << 1 | TW_READ, TW_MR_SLA_ACK))
        return fail();
    while (count--) {
        TWCR = (uint8_t)((1 << TWINT) | (1 << TWEN) | (count ? 1 << TWEA : 0));
        if (!wait(count ? TW_MR_DATA_ACK : TW_MR_DATA_NACK)) return fail();
        *to++ = TWDR;
    }
    stop();
    return 1;
}

uint8_t lis3dh_begin(void)
{
    uint8_t name = 0;
    TWBR = (F_CPU / 400000 - 16) / 2;
    TWSR = 0;
    return read(WHO_AM_I, &name, 1) && name == ITS_NAME && write(CTRL_REG1, 0) &&
           write(FIFO_CTRL, 0x00) &&  /* empties it */
           write(CTRL_REG2, 0x00) && write(INT1_CFG, 0x00) &&
           write(CTRL_REG3, 0x04) &&  /* its pin is high while there are samples */
           write(CTRL_REG4, 0x80) &&  /* +-2 g; a sample's bytes belong together */
           write(CTRL_REG5, 0x40) && write(FIFO_CTRL, 0x80) && /* the newest 32 samples */
           write(CTRL_REG1, 0x97);    /* 1344 Hz */
}

uint8_t lis3dh_read(int16_t *x, int16_t *y)
{
    uint8_t raw[6]; /* all three axes, for only that takes a sample out of its memory */
    if (!read(OUT_X | ONWARD, raw, sizeof raw)) return 0;
    *x = (int16_t)(raw[0] | raw[1] << 8);
    *y = (int16_t)(raw[2] | raw[3] << 8);
    return 1;
}

uint8_t lis3dh_sleep(void)
{
    return write(CTRL_REG1, 0) && write(FIFO_CTRL, 0x00) && write(CTRL_REG5, 0x00) &&
           write(CTRL_REG2, 0x01) &&     /* high-pass for the interrupt */
           write(INT1_THS, 2) &&         /* 16 mg each */
           write(INT1_DURATION, 0) && write(CTRL_REG3, 0x40) &&
           write(INT1_CFG, 0x0A) &&      /* x or y is high */
           write(CTRL_REG1, 0x5F);       /* 100 Hz, low power */
}

/* Mean of x, y and z, 1/16 mg; 0 where samples do not come. */
static uint8_t mean(int32_t sum[3], void (*feed)(void))
{
    uint8_t raw[6], state;
    sum[0] = sum[1] = sum[2] = 0;
    for (uint8_t n = 0; n < SETTLE_MS; n++) {
        feed();
        _delay_ms(1);
    }
    for (uint8_t n = 0; n <= MEAN; n++) { /* the first one is of before */
        uint8_t left = 40;                /* looks, of more than 100 us each */
        feed();
        do {
            if (!left-- || !read(STATUS, &state, 1)) return 0;
        } while (!(state & FRESH));
        if (!read(OUT_X | ONWARD, raw, sizeof raw)) return 0;
        for (uint8_t k = 0; n && k < 3; k++) sum[k] += (int16_t)(raw[2 * k] | raw[2 * k + 1] << 8);
    }
    return 1;
}

uint8_t lis3dh_test(int16_t change_mg[3], void (*feed)(void))
{
    int32_t rest[3], pulled[3];
    uint8_t name = 0;
    if (!read(WHO_AM_I, &name, 1) || name != ITS_NAME) return 0;
    if (write(CTRL_REG1, 0) && write(CTRL_REG3, 0) && write(CTRL_REG5, 0) && write(FIFO_CTRL, 0) &&
        write(CTRL_REG4, 0x80) && write(CTRL_REG1, 0x97) && mean(rest, feed) && write(CTRL_REG4, 0x82) &&
        mean(pulled, feed))
        for (uint8_t k = 0; k < 3; k++) change_mg[k] = (int16_t)((pulled[k] - rest[k]) / (16 * MEAN));
    return 1;
}
