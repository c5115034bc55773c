/* SPDX-License-Identifier: Apache-2.0 */
/* A cable that takes its time: each frame that a machine puts into one end comes out of the other
   so much later. The ends are TAP devices in two network namespaces.
   Arguments: NAMESPACE DEVICE NAMESPACE DEVICE MICROSECONDS. Prints a line once it is plugged in. */
#define _GNU_SOURCE
#include <fcntl.h>
#include <linux/if.h>
#include <linux/if_tun.h>
#include <poll.h>
#include <sched.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <time.h>
#include <unistd.h>

#define DEPTH 8192 /* frames on their way; more are lost */
#define NS 1000000000LL

struct frame {
    int64_t due_ns;
    ssize_t size;
    unsigned char bytes[1536];
};

static struct {
    struct frame frames[DEPTH];
    unsigned first, count;
} ways[2];

static int64_t now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * NS + now.tv_nsec;
}

static int plug(const char *namespace, const char *device)
{
    struct ifreq asked = {.ifr_flags = IFF_TAP | IFF_NO_PI};
    char path[256];
    int place, tap;

    snprintf(path, sizeof path, "/run/netns/%s", namespace);
    strncpy(asked.ifr_name, device, IFNAMSIZ - 1);
    if ((place = open(path, O_RDONLY)) < 0 || setns(place, CLONE_NEWNET)
        || (tap = open("/dev/net/tun", O_RDWR | O_NONBLOCK)) < 0 || ioctl(tap, TUNSETIFF, &asked)) {
        perror(device);
        exit(1);
    }
    return tap;
}

int main(int count, char **words)
{
    if (count != 6)
        return 2;
    int taps[2] = {plug(words[1], words[2]), plug(words[3], words[4])};
    int64_t delay_ns = atoll(words[5]) * 1000;
    puts("plugged in");
    fflush(stdout);
    for (;;) {
        int64_t wait_ns = NS;
        for (int k = 0; k < 2; k++) {
            for (; ways[k].count; ways[k].first = (ways[k].first + 1) % DEPTH, ways[k].count--) {
                struct frame *frame = &ways[k].frames[ways[k].first];
                int64_t left_ns = frame->due_ns - now_ns();
                if (left_ns > 0) {
                    wait_ns = left_ns < wait_ns ? left_ns : wait_ns;
                    break;
                }
                if (write(taps[!k], frame->bytes, frame->size) < 0)
                    continue; /* the other end is down: it is lost */
            }
        }
        struct pollfd ends[2] = {{.fd = taps[0], .events = POLLIN}, {.fd = taps[1], .events = POLLIN}};
        struct timespec wait = {wait_ns / NS, wait_ns % NS};
        if (ppoll(ends, 2, &wait, NULL) < 0)
            return 1;
        for (int k = 0; k < 2; k++)
            for (;;) {
                struct frame *frame = &ways[k].frames[(ways[k].first + ways[k].count) % DEPTH];
                frame->size = read(taps[k], frame->bytes, sizeof frame->bytes);
                if (frame->size <= 0)
                    break;
                frame->due_ns = now_ns() + delay_ns;
                ways[k].count += ways[k].count < DEPTH - 1;
            }
    }
}
