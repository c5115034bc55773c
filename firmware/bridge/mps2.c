/* SPDX-License-Identifier: Apache-2.0
 *
 * The bridge on a Cortex-M3 as Arm's MPS2 board with image AN385 has it, which QEMU emulates: the
 * host on UART 0, the radio on UART 1 as packets of kind EOL_AIR. It sleeps until a byte comes or a
 * millisecond has passed; a watchdog starts it again when its loop has not come round for 0.2 s.
 *
 *     qemu-system-arm -M mps2-an385 -kernel bridge.elf -display none -serial pty -serial unix:SOCKET
 */
#include <stddef.h>
#include <stdint.h>

#include "bridge.h"
#include "start.h"

typedef volatile struct {
    uint32_t data, state, control, interrupt, divider;
} uart;

typedef volatile struct {
    uint32_t control, value, reload, interrupt;
} timer;

typedef volatile struct {
    uint32_t load, value, control, clear, raw, masked, unused[762], lock;
} watchdog;

#define HOST ((uart *)0x40004000u)
#define RADIO ((uart *)0x40005000u)
#define TIMER ((timer *)0x40000000u)
#define WATCHDOG ((watchdog *)0x40008000u)
#define SYSTICK ((volatile uint32_t *)0xE000E010u)
#define INTERRUPTS (*(volatile uint32_t *)0xE000E100u)

enum {
    CLOCK_HZ = 25000000,
    FULL = 1, READY = 2,             /* of a UART's state: cannot take a byte, has one */
    WORKS = 0x0F,                    /* sends, receives, and interrupts where it has done so */
    SENT = 1, RECEIVED = 2,          /* of its interrupts */
    UARTS = 0x0F,                    /* of the controller's: two of each */
    HUNG_US = 200000,
    UNLOCK = 0x1ACCE551,
    WAITING = 256                    /* bytes of each line that may come within a turn of the loop */
};

static eol_bridge bridge;
static eol_decoder air;

typedef struct {
    uint8_t bytes[WAITING];
    volatile uint16_t begin, end;
} queue;

static queue from_host, from_radio;

static void receive(uart *port, queue *to)
{
    port->interrupt = RECEIVED; /* first: what comes meanwhile raises it again */
    while (port->state & READY) {
        uint16_t next = (uint16_t)((to->end + 1) % WAITING);
        uint8_t byte = (uint8_t)port->data;
        if (next == to->begin) continue; /* lost: the checksum shows it */
        to->bytes[to->end] = byte;
        to->end = next;
    }
}

static void on_host(void)
{
    receive(HOST, &from_host);
}

static void on_radio(void)
{
    receive(RADIO, &from_radio);
}

static void on_sent(void)
{
    HOST->interrupt = RADIO->interrupt = SENT;
}

static void on_tick(void)
{
}

static int next_byte(queue *from, uint8_t *byte)
{
    if (from->begin == from->end) return 0;
    *byte = from->bytes[from->begin];
    from->begin = (uint16_t)((from->begin + 1) % WAITING);
    return 1;
}

static uint64_t clock_us(void)
{
    static uint32_t before;
    static uint64_t ticks;
    uint32_t now = ~TIMER->value; /* it counts down */
    ticks += now - before;
    before = now;
    return ticks / (CLOCK_HZ / 1000000);
}

/* A line never keeps the loop waiting: what it cannot take now it is offered again. */
static int put(uart *port, uint8_t byte)
{
    if (port->state & FULL) return 0;
    port->data = byte;
    return 1;
}

static void send_host(void)
{
    static uint8_t pending, waits;
    while (waits || (waits = eol_bridge_sends(&bridge, &pending))) {
        if (!put(HOST, pending)) return;
        waits = 0;
    }
}

static void send_radio(void)
{
    static uint8_t wire[EOL_MAX_WIRE], sequence;
    static size_t length, at;
    uint8_t frame[EOL_FRAME];
    for (;;) {
        if (at == length) {
            if (!eol_bridge_says(&bridge, clock_us(), frame)) return;
            length = eol_encode(wire, EOL_AIR, sequence++, frame, EOL_FRAME);
            at = 0;
        }
        while (at < length) {
            if (!put(RADIO, wire[at])) return;
            at++;
        }
    }
}

static void feed_watchdog(void)
{
    WATCHDOG->lock = UNLOCK;
    WATCHDOG->load = CLOCK_HZ / 1000000 * HUNG_US / 2; /* it resets when that has passed twice */
    WATCHDOG->clear = 1;
    WATCHDOG->lock = 0;
}

static void begin(void)
{
    HOST->divider = RADIO->divider = CLOCK_HZ / 1000000;
    HOST->control = RADIO->control = WORKS;
    TIMER->reload = TIMER->value = 0xFFFFFFFFu;
    TIMER->control = 1;
    SYSTICK[1] = CLOCK_HZ / 1000 - 1;
    SYSTICK[0] = 7;
    INTERRUPTS = UARTS;
    WATCHDOG->lock = UNLOCK;
    WATCHDOG->load = CLOCK_HZ / 1000000 * HUNG_US / 2;
    WATCHDOG->control = 3;
    WATCHDOG->lock = 0;
}

int main(void)
{
    uint8_t byte, kind;
    const uint8_t *body;
    size_t size;
    begin();
    eol_bridge_begin(&bridge, clock_us());
    for (;;) {
        feed_watchdog();
        while (next_byte(&from_radio, &byte))
            if (eol_decode(&air, byte, &kind, &body, &size) && kind == EOL_AIR && size == EOL_FRAME)
                eol_bridge_heard(&bridge, clock_us(), body);
        while (next_byte(&from_host, &byte)) eol_bridge_byte(&bridge, clock_us(), byte);
        send_radio();
        send_host();
        __asm volatile("cpsid i" ::: "memory"); /* what comes now wakes it all the same */
        if (from_host.begin == from_host.end && from_radio.begin == from_radio.end)
            __asm volatile("wfi"); /* until a byte has come or gone, or a millisecond passed */
        __asm volatile("cpsie i" ::: "memory");
    }
}

__attribute__((used, section(".vectors"))) static const handler VECTORS[16 + 4] = {
    (handler)stack_end, on_reset, on_fault, on_fault, on_fault, on_fault, on_fault, 0, 0, 0, 0, on_fault,
    on_fault, 0, on_fault, on_tick, on_host, on_sent, on_radio, on_sent,
};
