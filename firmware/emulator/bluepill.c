/* SPDX-License-Identifier: Apache-2.0
 *
 * The bridge in emulation, for the tests: Unicorn runs the very program that is written into an
 * STM32F103C8, and here is what lies around its processor: clock tree, pins, SPI 1, USART 1 with its
 * two DMA channels, timer 2, EXTI, SysTick, the watchdog, as RM0008 has them; an nRF24L01+ on the
 * pins of bridge/pins.h. Loaded with ctypes; test/support/emulated_bluepill.py.
 *
 * A peripheral whose clock is off does nothing, a pin that was not set up moves nothing, and whatever
 * else the manual forbids or this does not know is counted in `strange`. Interrupts are only ever
 * masked and pending: one that would be taken is strange, too. A halfword of code counts as a cycle,
 * so time is about right where the processor is busy, and exact where it waits, sends or shifts.
 */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <unicorn/unicorn.h>

#include "../bridge/pins.h"
#include "../link.h"
#include "radio.h"

enum { FLASH_AT = 0x08000000, FLASH_SIZE = 0x10000, RAM_AT = 0x20000000, RAM_SIZE = 0x5000, BUS_AT = 0x40000000, BUS_SIZE = 0x24000, CORE_AT = (int)0xE000E000, CORE_SIZE = 0x1000 };
enum { FULL_HZ = 72000000, LSI_HZ = 40000, BAUD = 1000000, BITS = 10, ROOM = 1 << 16, PACKETS = 4096 };
enum { RCC = 0x21000, FLASH = 0x22000, DMA = 0x20000, GPIOA = 0x10800, GPIOB = 0x10C00, GPIOC = 0x11000, AFIO = 0x10000, EXTI = 0x10400, SPI1 = 0x13000, USART1 = 0x13800, TIM2 = 0, IWDG = 0x3000 };

typedef struct {
    uint8_t bytes[ROOM];
    uint64_t begin, end;
} line;

typedef struct {
    uint64_t cycles, resets, strange, lost, stack, asleep;
} counts;

typedef struct {
    uc_engine *core;
    uint64_t cycle, next; /* next: when something outside the processor happens */
    uint32_t reg[BUS_SIZE / 4];
    uint32_t tick_load, tick_control, enabled, pending;
    uint64_t ticked, fed, shifted, timer_from, from_next, to_next;
    uint32_t reload, divider;
    uint8_t tick_pending, watched, writable, spi_in, spi_full, to_busy, sleeps, hung;
    uint64_t limit;
    line from_host, to_host;
    radio radio;
    radio_packet sent[PACKETS];
    uint32_t sent_count;
    uint8_t irq;
    counts counts;
} emulator;

static uint32_t *at(emulator *e, uint32_t offset)
{
    return &e->reg[offset / 4];
}

static uint64_t ns(const emulator *e)
{
    return e->cycle * 125 / 9;
}

static uint64_t cycle_of(uint64_t time_ns)
{
    return (time_ns * 9 + 124) / 125;
}

static int on(emulator *e, uint32_t bus, uint32_t bit)
{
    return *at(e, RCC + bus) >> bit & 1;
}

static int clocked(emulator *e, uint32_t offset)
{
    switch (offset & ~0x3FFu) {
    case TIM2: return on(e, 0x1C, 0);
    case AFIO: return on(e, 0x18, 0);
    case GPIOA: return on(e, 0x18, 2);
    case GPIOB: return on(e, 0x18, 3);
    case GPIOC: return on(e, 0x18, 4);
    case SPI1: return on(e, 0x18, 12);
    case USART1: return on(e, 0x18, 14);
    case DMA: return on(e, 0x14, 0);
    case RCC: case FLASH: case IWDG: case EXTI: return 1;
    default: return 0;
    }
}

/* Four bits of a pin: mode and, above, configuration. */
static uint32_t mode(emulator *e, uint32_t port, unsigned number)
{
    return *at(e, port + (number / 8) * 4) >> 4 * (number % 8) & 15;
}

static int drives(emulator *e, uint32_t port, unsigned number)
{
    return (mode(e, port, number) & 3) != 0 && mode(e, port, number) < 8;
}

static int alternate(emulator *e, unsigned number)
{
    return (mode(e, GPIOA, number) & 3) != 0 && (mode(e, GPIOA, number) & 12) == 8;
}

static int reads(emulator *e, uint32_t port, unsigned number, int pulled)
{
    uint32_t m = mode(e, port, number);
    return m == 8 ? !pulled || *at(e, port + 0x0C) >> number & 1 : m == 4 && !pulled;
}

/* What the firmware has done to the pins is what the radio sees. */
static void move_pins(emulator *e)
{
    if (drives(e, GPIOA, RADIO_CSN)) radio_csn(&e->radio, *at(e, GPIOA + 0x0C) >> RADIO_CSN & 1);
    if (drives(e, GPIOB, RADIO_CE)) radio_ce(&e->radio, *at(e, GPIOB + 0x0C) >> RADIO_CE & 1, ns(e));
}

/* IRQ has a falling edge: EXTI, where it is set up for that, wakes the processor. */
static void look_at_irq(emulator *e)
{
    uint8_t level = (uint8_t)radio_irq(&e->radio);
    if (e->irq && !level && *at(e, EXTI + 0x0C) >> RADIO_IRQ & 1) {
        if ((*at(e, AFIO + 8) >> 4 * RADIO_IRQ & 15) == 1 && reads(e, GPIOB, RADIO_IRQ, 1)) {
            *at(e, EXTI + 0x14) |= 1u << RADIO_IRQ;
            if (*at(e, EXTI) >> RADIO_IRQ & 1) e->pending |= 1u << 7;
        }
    }
    e->irq = level;
}

static void soon(emulator *e, uint64_t cycle)
{
    if (cycle < e->next) e->next = cycle;
}

static void schedule(emulator *e)
{
    e->next = e->limit;
    if (e->tick_control & 1) soon(e, e->ticked + e->tick_load + 1);
    if (e->from_host.begin != e->from_host.end) soon(e, e->from_next);
    if (e->to_busy) soon(e, e->to_next);
    if (e->radio.phase != RADIO_RESTS) soon(e, cycle_of(e->radio.phase_ends_ns));
    if (e->watched) soon(e, e->fed + (uint64_t)(e->reload + 1) * (4u << e->divider) * (FULL_HZ / LSI_HZ));
}

/* ---- SPI */

static void shift(emulator *e, uint8_t out)
{
    uint32_t cr1 = *at(e, SPI1);
    if (e->cycle < e->shifted) e->counts.strange++; /* the byte before has not gone out */
    if (e->spi_full) e->counts.strange++;           /* nor was read */
    if ((cr1 & 0x344) != 0x344 || cr1 & 0x883) { /* on, master, no NSS; mode 0, 8 bits, the highest one first */
        e->counts.strange++;
        return;
    }
    uint64_t cycles = 8 * (2ull << (cr1 >> 3 & 7));
    if (FULL_HZ / (2u << (cr1 >> 3 & 7)) > 8000000) e->counts.strange++;
    if (alternate(e, SCK) && alternate(e, MOSI)) {
        e->spi_in = radio_byte(&e->radio, out, ns(e));
        if (!reads(e, GPIOA, MISO, 0)) e->spi_in = 0;
        look_at_irq(e);
    } else {
        e->counts.strange++;
    }
    e->spi_full = 1;
    e->shifted = e->cycle + cycles;
}

/* ---- USART */

static int usart_works(emulator *e, uint32_t bits)
{
    return on(e, 0x18, 14) && (*at(e, USART1 + 0x0C) & (1u << 13 | bits)) == (1u << 13 | bits);
}

static uint64_t byte_cycles(emulator *e)
{
    return BITS * (uint64_t)*at(e, USART1 + 8);
}

static int right_rate(emulator *e)
{
    uint64_t wanted = BITS * (FULL_HZ / BAUD), is = byte_cycles(e);
    return is * 50 > wanted * 49 && is * 50 < wanted * 51;
}

static uint32_t channel(unsigned n) { return DMA + 8 + 20 * (n - 1); }

static uint32_t dma_reg(emulator *e, unsigned n, unsigned which)
{
    return *at(e, channel(n) + 4 * which);
}

static int dma_on(emulator *e, unsigned n, uint32_t wanted)
{
    uint32_t ccr = dma_reg(e, n, 0);
    return on(e, 0x14, 0) && (ccr & wanted) == wanted && !(ccr & 0x0F40) && dma_reg(e, n, 2) == BUS_AT + USART1 + 4;
}

static uint32_t dma_next(emulator *e, unsigned n)
{
    uint32_t *left = at(e, channel(n) + 4);
    uint32_t *full = at(e, channel(n) + 16); /* behind CMAR: what it was set to */
    uint32_t address = dma_reg(e, n, 3) + *full - *left;
    if (!--*left && dma_reg(e, n, 0) & 0x20) *left = *full;
    return address;
}

static void take_from_host(emulator *e)
{
    uint8_t byte = e->from_host.bytes[e->from_host.begin++ % ROOM];
    e->from_next = e->cycle + BITS * (FULL_HZ / BAUD);
    if (!right_rate(e)) byte ^= 0x5A;
    if (usart_works(e, 4) && *at(e, USART1 + 0x14) >> 6 & 1 && reads(e, GPIOA, FROM_HOST, 0) && dma_on(e, 5, 0xA1) && dma_reg(e, 5, 1)) {
        if (uc_mem_write(e->core, dma_next(e, 5), &byte, 1)) e->counts.strange++;
    } else {
        e->counts.lost++;
    }
}

static void begin_to_host(emulator *e)
{
    if (e->to_busy || !usart_works(e, 8) || !(*at(e, USART1 + 0x14) >> 7 & 1) || !dma_on(e, 4, 0x91) || !dma_reg(e, 4, 1)) return;
    e->to_busy = 1;
    e->to_next = e->cycle + byte_cycles(e);
}

static void give_to_host(emulator *e)
{
    uint8_t byte;
    e->to_busy = 0;
    if (!dma_on(e, 4, 0x91) || !dma_reg(e, 4, 1)) return;
    if (uc_mem_read(e->core, dma_next(e, 4), &byte, 1)) e->counts.strange++;
    if (!right_rate(e) || !alternate(e, TO_HOST)) byte ^= 0x5A;
    if (e->to_host.end - e->to_host.begin < ROOM) e->to_host.bytes[e->to_host.end++ % ROOM] = byte;
    begin_to_host(e);
}

/* ---- registers */

static uint32_t odr_after(uint32_t odr, uint32_t set) { return (odr & ~(set >> 16)) | (set & 0xFFFF); }

static uint16_t timer_count(emulator *e)
{
    return *at(e, TIM2) & 1 ? (uint16_t)((e->cycle - e->timer_from) / (*at(e, TIM2 + 0x28) + 1)) : 0;
}

static uint32_t inputs(emulator *e, uint32_t port)
{
    uint32_t found = 0;
    for (unsigned k = 0; k < 16; k++) {
        int level = port == GPIOB && k == RADIO_IRQ ? radio_irq(&e->radio) : (int)(*at(e, port + 0x0C) >> k & 1);
        found |= (uint32_t)level << k;
    }
    return found;
}

static uint64_t bus_read(uc_engine *core, uint64_t offset, unsigned size, void *param)
{
    emulator *e = param;
    uint32_t o = (uint32_t)offset;
    (void)core;
    (void)size;
    if (!clocked(e, o)) {
        e->counts.strange++;
        return 0;
    }
    switch (o) {
    case RCC: return *at(e, o) | (*at(e, o) & 1u << 16 ? 1u << 17 : 0) | (*at(e, o) & 1u << 24 ? 1u << 25 : 0) | 2;
    case RCC + 4: return (*at(e, o) & ~12u) | (*at(e, o) & 3) << 2;
    case GPIOA + 8: case GPIOB + 8: case GPIOC + 8: return inputs(e, o & ~0x3FFu);
    case SPI1 + 8: return (e->cycle >= e->shifted ? 2u : 0x80u) | (e->spi_full && e->cycle >= e->shifted);
    case SPI1 + 12: e->spi_full = 0; return e->spi_in;
    case USART1: return 0xC0;
    case TIM2 + 0x24: return timer_count(e);
    case IWDG + 12: return 0;
    default: return *at(e, o);
    }
}

static void dog(emulator *e, uint32_t o, uint32_t value)
{
    if (o == IWDG) {
        if (value == 0xCCCC) e->watched = 1;
        e->writable = value == 0x5555;
        if (value == 0xCCCC || value == 0xAAAA) {
            e->fed = e->cycle;
            e->reload = *at(e, IWDG + 8);
            e->divider = *at(e, IWDG + 4);
        }
    } else if (e->writable) {
        *at(e, o) = value;
    } else {
        e->counts.strange++;
    }
}

static void clock_changes(emulator *e)
{
    uint32_t cfgr = *at(e, RCC + 4);
    if ((cfgr & 3) != 2) return;
    /* crystal of 8 MHz times nine; APB1 at half of that; the flash waits twice */
    if ((*at(e, RCC) & 0x01010000) != 0x01010000 || (cfgr >> 16 & 0x3F) != 0x1D || (cfgr >> 8 & 7) != 4 || cfgr & 0x38F0 ||
        (*at(e, FLASH) & 7) != 2)
        e->counts.strange++;
}

static void bus_write(uc_engine *core, uint64_t offset, unsigned size, uint64_t written, void *param)
{
    emulator *e = param;
    uint32_t o = (uint32_t)offset, value = (uint32_t)written, port = o & ~0x3FFu;
    (void)core;
    if (!clocked(e, o) || size != 4) {
        e->counts.strange++;
        return;
    }
    if (port == IWDG) {
        dog(e, o, value);
    } else if (port == GPIOA || port == GPIOB || port == GPIOC) {
        if (o - port == 0x10) *at(e, port + 0x0C) = odr_after(*at(e, port + 0x0C), value);
        else if (o - port == 0x14) *at(e, port + 0x0C) &= ~value;
        else *at(e, o) = value;
        move_pins(e);
        look_at_irq(e);
    } else if (o == SPI1 + 12) {
        shift(e, (uint8_t)value);
    } else if (o == EXTI + 0x14) {
        *at(e, o) &= ~value;
    } else if (o == TIM2 + 0x14) {
        e->timer_from = e->cycle;
    } else if (port == DMA && o >= DMA + 8) {
        unsigned n = (o - DMA - 8) / 20 + 1, which = (o - DMA - 8) % 20 / 4;
        if (n != 4 && n != 5) e->counts.strange++;
        if (which && dma_reg(e, n, 0) & 1) e->counts.strange++; /* not while it is on */
        if (which == 4) e->counts.strange++;
        *at(e, o) = value;
        if (which == 1) *at(e, o + 12) = value;
        if (which == 0) begin_to_host(e);
    } else {
        *at(e, o) = value;
        if (o == TIM2) e->timer_from = e->cycle;
        if (o == RCC + 4) clock_changes(e);
        if (port == USART1) begin_to_host(e);
    }
    schedule(e);
}

static uint64_t core_read(uc_engine *core, uint64_t offset, unsigned size, void *param)
{
    emulator *e = param;
    (void)core;
    (void)size;
    if (offset == 0x10) return e->tick_control;
    e->counts.strange++;
    return 0;
}

static void core_write(uc_engine *core, uint64_t offset, unsigned size, uint64_t value, void *param)
{
    emulator *e = param;
    (void)core;
    (void)size;
    switch (offset) {
    case 0x10: e->tick_control = (uint32_t)value; e->ticked = e->cycle; break;
    case 0x14: e->tick_load = (uint32_t)value; break;
    case 0x18: e->ticked = e->cycle; break;
    case 0x100: e->enabled |= (uint32_t)value; break;
    case 0x280: e->pending &= ~(uint32_t)value; break;
    case 0xD04: if (value == 1u << 25) e->tick_pending = 0; else e->counts.strange++; break;
    default: e->counts.strange++;
    }
    /* a request that is still there is pending again at once */
    if (*at(e, EXTI + 0x14) & *at(e, EXTI) & 1u << RADIO_IRQ) e->pending |= 1u << 7;
    schedule(e);
}

/* ---- time */

static void start(emulator *e)
{
    uint32_t words[2], zero = 0;
    memset(e->reg, 0, sizeof e->reg);
    *at(e, RCC) = 0x83;
    *at(e, RCC + 0x14) = 0x14;
    *at(e, FLASH) = 0x30;
    *at(e, IWDG + 8) = 0xFFF;
    for (uint32_t port = GPIOA; port <= GPIOC; port += 0x400) *at(e, port) = *at(e, port + 4) = 0x44444444;
    *at(e, TIM2 + 0x2C) = 0xFFFF;
    e->tick_load = e->tick_control = e->enabled = e->pending = 0;
    e->tick_pending = e->watched = e->writable = e->spi_full = e->to_busy = e->sleeps = e->hung = 0;
    e->shifted = 0;
    radio_ce(&e->radio, 0, ns(e)); /* pins float, and a pull-down and a pull-up of the module's keep it quiet */
    radio_csn(&e->radio, 1);
    uc_mem_read(e->core, FLASH_AT, words, sizeof words);
    uc_reg_write(e->core, UC_ARM_REG_SP, &words[0]);
    uc_reg_write(e->core, UC_ARM_REG_PC, &words[1]);
    uc_reg_write(e->core, UC_ARM_REG_PRIMASK, &zero);
}

static void happen(emulator *e)
{
    if (e->tick_control & 1 && e->cycle >= e->ticked + e->tick_load + 1) {
        e->ticked += ((e->cycle - e->ticked) / (e->tick_load + 1)) * (e->tick_load + 1);
        if (e->tick_control & 2) e->tick_pending = 1;
    }
    while (e->from_host.begin != e->from_host.end && e->cycle >= e->from_next) take_from_host(e);
    if (e->to_busy && e->cycle >= e->to_next) give_to_host(e);
    radio_advance(&e->radio, ns(e));
    if (e->radio.was_sent) {
        e->radio.was_sent = 0;
        if (e->sent_count < PACKETS) e->sent[e->sent_count++] = e->radio.sent;
    }
    look_at_irq(e);
    if (e->watched && e->cycle >= e->fed + (uint64_t)(e->reload + 1) * (4u << e->divider) * (FULL_HZ / LSI_HZ)) {
        e->counts.resets++;
        start(e);
        uc_emu_stop(e->core);
    }
    schedule(e);
}

static void on_block(uc_engine *core, uint64_t address, uint32_t size, void *param)
{
    emulator *e = param;
    (void)address;
    e->cycle += size / 2;
    if (e->cycle < e->next) return;
    uc_emu_stop(core);
}

static void note_stack(emulator *e)
{
    uint32_t sp;
    uc_reg_read(e->core, UC_ARM_REG_SP, &sp);
    if (RAM_AT + RAM_SIZE - sp > e->counts.stack) e->counts.stack = RAM_AT + RAM_SIZE - sp;
}

void bluepill_run(emulator *e, uint64_t until_us)
{
    e->limit = until_us * (FULL_HZ / 1000000);
    schedule(e);
    while (e->cycle < e->limit) {
        if (e->cycle >= e->next) happen(e);
        if (e->tick_pending || e->pending & e->enabled) e->sleeps = 0;
        if (e->sleeps || e->hung) {
            e->counts.asleep += e->next > e->cycle ? e->next - e->cycle : 0;
            if (e->next > e->cycle) e->cycle = e->next;
            continue;
        }
        uint32_t pc, masked;
        uint16_t before = 0;
        uc_reg_read(e->core, UC_ARM_REG_PC, &pc);
        if (uc_emu_start(e->core, pc | 1, 0, 0, 0)) {
            e->hung = 1; /* a fault: it waits for the watchdog */
            continue;
        }
        uc_reg_read(e->core, UC_ARM_REG_PC, &pc);
        uc_reg_read(e->core, UC_ARM_REG_PRIMASK, &masked);
        uc_mem_read(e->core, pc - 2, &before, 2);
        note_stack(e);
        if (!masked && (e->tick_pending || e->pending & e->enabled)) e->counts.strange++;
        if (before == 0xBF30 && e->cycle < e->next) e->sleeps = 1; /* wfi */
    }
}

emulator *bluepill_new(const uint8_t *code, uint32_t size)
{
    static const uint8_t PATTERN[RAM_SIZE];
    emulator *e = calloc(1, sizeof *e);
    uc_hook hook;
    uc_err wrong;
    if (size > FLASH_SIZE || uc_open(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS, &e->core)) return NULL;
    wrong = uc_ctl_set_cpu_model(e->core, UC_CPU_ARM_CORTEX_M3);
    wrong |= uc_mem_map(e->core, FLASH_AT, FLASH_SIZE, UC_PROT_READ | UC_PROT_EXEC);
    wrong |= uc_mem_map(e->core, RAM_AT, RAM_SIZE, UC_PROT_READ | UC_PROT_WRITE);
    wrong |= uc_mmio_map(e->core, BUS_AT, BUS_SIZE, bus_read, e, bus_write, e);
    wrong |= uc_mmio_map(e->core, (uint32_t)CORE_AT, CORE_SIZE, core_read, e, core_write, e);
    wrong |= uc_mem_write(e->core, FLASH_AT, code, size);
    wrong |= uc_mem_write(e->core, RAM_AT, PATTERN, sizeof PATTERN);
    wrong |= uc_hook_add(e->core, &hook, UC_HOOK_BLOCK, (void *)on_block, e, 1, 0);
    if (wrong) return NULL;
    radio_begin(&e->radio);
    e->irq = 1;
    start(e);
    return e;
}

void bluepill_free(emulator *e)
{
    uc_close(e->core);
    free(e);
}

/* Bytes of the host, at 1 Mbaud; returns how many fit in. */
uint32_t bluepill_write(emulator *e, const uint8_t *bytes, uint32_t count)
{
    uint32_t k = 0;
    if (e->from_host.begin == e->from_host.end && e->from_next < e->cycle) e->from_next = e->cycle + BITS * (FULL_HZ / BAUD);
    while (k < count && e->from_host.end - e->from_host.begin < ROOM) e->from_host.bytes[e->from_host.end++ % ROOM] = bytes[k++];
    return k;
}

uint32_t bluepill_read(emulator *e, uint8_t *to, uint32_t room)
{
    uint32_t k = 0;
    while (k < room && e->to_host.begin != e->to_host.end) to[k++] = e->to_host.bytes[e->to_host.begin++ % ROOM];
    return k;
}

/* What its radio has sent since the last call. */
uint32_t bluepill_sent(emulator *e, radio_packet *to, uint32_t room)
{
    uint32_t count = e->sent_count < room ? e->sent_count : room;
    memcpy(to, e->sent, count * sizeof *to);
    e->sent_count = 0;
    return count;
}

/* A packet has ended now; 1 when its radio has taken it. It has answered when bluepill_answered says so. */
int bluepill_hears(emulator *e, const radio_packet *packet)
{
    int took = radio_hears(&e->radio, packet);
    look_at_irq(e);
    return took;
}

int bluepill_answered(const emulator *e) { return e->radio.answered; }

/* Break or mend the radio (radio.h: `fault`), or let its supply fail for a moment (-1). */
void bluepill_radio_fault(emulator *e, int fault)
{
    if (fault < 0) radio_reset(&e->radio);
    else e->radio.fault = (uint8_t)fault;
    look_at_irq(e);
}

void bluepill_reset(emulator *e) { start(e); }

/* Jump to `address`, an endless loop say. */
void bluepill_jump(emulator *e, uint32_t address)
{
    address |= 1;
    e->sleeps = 0;
    uc_reg_write(e->core, UC_ARM_REG_PC, &address);
}

void bluepill_counts(const emulator *e, uint64_t *to)
{
    memcpy(to, &e->counts, sizeof e->counts);
    to[0] = e->cycle;
    to[2] += e->radio.strange;
}

int bluepill_lit(emulator *e) { return drives(e, GPIOC, LIT) && !(*at(e, GPIOC + 0x0C) >> LIT & 1); }
