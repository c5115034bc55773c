/* SPDX-License-Identifier: Apache-2.0 */
/* A system clock that a test or a soak sets: with this in LD_PRELOAD, the int64 of nanoseconds with
   which the file $FAKE_CLOCK begins is added to the time of all that asks libc. Waits until a time
   of that clock (conditions, semaphores, mutexes) follow it too, also where it is set meanwhile:
   set back, they last longer, as with the clock of a real machine. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define SLICE_NS 20000000LL /* so soon a wait notices that the clock was set */

typedef int clock_call(clockid_t, struct timespec *);
typedef int cond_call(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);
typedef int cond_clock_call(pthread_cond_t *, pthread_mutex_t *, clockid_t,
                            const struct timespec *);
typedef int sem_call(sem_t *, const struct timespec *);
typedef int mutex_call(pthread_mutex_t *, const struct timespec *);

static clock_call *real;
static cond_call *real_cond;
static cond_clock_call *real_cond_clock;
static sem_call *real_sem;
static mutex_call *real_mutex;
static volatile int64_t *offset;

__attribute__((constructor)) static void begin(void)
{
    const char *path = getenv("FAKE_CLOCK");
    int file = path ? open(path, O_RDONLY) : -1;
    real = (clock_call *)dlsym(RTLD_NEXT, "clock_gettime");
    /* Of two versions dlsym gives the one of before NPTL. */
    real_cond = (cond_call *)dlvsym(RTLD_NEXT, "pthread_cond_timedwait", "GLIBC_2.3.2");
    if (!real_cond)
        real_cond = (cond_call *)dlsym(RTLD_NEXT, "pthread_cond_timedwait");
    real_cond_clock = (cond_clock_call *)dlsym(RTLD_NEXT, "pthread_cond_clockwait");
    real_sem = (sem_call *)dlsym(RTLD_NEXT, "sem_timedwait");
    real_mutex = (mutex_call *)dlsym(RTLD_NEXT, "pthread_mutex_timedlock");
    if (file >= 0) {
        void *map = mmap(0, 8, PROT_READ, MAP_SHARED, file, 0);
        close(file);
        if (map != MAP_FAILED)
            offset = map;
    }
}

static int64_t ns_of(const struct timespec *t)
{
    return t->tv_sec * 1000000000LL + t->tv_nsec;
}

static struct timespec at(int64_t ns)
{
    struct timespec t = {ns / 1000000000LL, ns % 1000000000LL};
    return t;
}

static int64_t true_ns(clockid_t which)
{
    struct timespec t;
    if (!real)
        begin();
    real(which, &t);
    return ns_of(&t);
}

int clock_gettime(clockid_t which, struct timespec *now)
{
    if (!real)
        begin();
    int code = real(which, now);
    if (!code && offset && (which == CLOCK_REALTIME || which == CLOCK_REALTIME_COARSE))
        *now = at(ns_of(now) + *offset);
    return code;
}

/* The next moment of the true clock at which a wait until `until` of the set clock looks again. */
static struct timespec slice(const struct timespec *until)
{
    int64_t now = true_ns(CLOCK_REALTIME), end = ns_of(until) - *offset;
    return at(end < now + SLICE_NS ? end : now + SLICE_NS);
}

static int over(const struct timespec *until)
{
    return true_ns(CLOCK_REALTIME) + *offset >= ns_of(until);
}

int pthread_cond_timedwait(pthread_cond_t *cond, pthread_mutex_t *mutex,
                           const struct timespec *until)
{
    if (!real)
        begin();
    /* Of which clock the condition is it does not say: of the one that is nearer. */
    int64_t to_set = offset ? llabs(ns_of(until) - true_ns(CLOCK_REALTIME) - *offset) : 0;
    if (!offset || llabs(ns_of(until) - true_ns(CLOCK_MONOTONIC)) < to_set)
        return real_cond(cond, mutex, until);
    struct timespec next = slice(until);
    int code = real_cond(cond, mutex, &next);
    return code == ETIMEDOUT && !over(until) ? 0 : code; /* it may wake for nothing */
}

int pthread_cond_clockwait(pthread_cond_t *cond, pthread_mutex_t *mutex, clockid_t which,
                           const struct timespec *until)
{
    if (!real)
        begin();
    if (!offset || which != CLOCK_REALTIME)
        return real_cond_clock(cond, mutex, which, until);
    struct timespec next = slice(until);
    int code = real_cond_clock(cond, mutex, which, &next);
    return code == ETIMEDOUT && !over(until) ? 0 : code;
}

int sem_timedwait(sem_t *sem, const struct timespec *until)
{
    if (!real)
        begin();
    if (!offset)
        return real_sem(sem, until);
    for (;;) {
        struct timespec next = slice(until);
        int code = real_sem(sem, &next);
        if (!code || errno != ETIMEDOUT || over(until))
            return code;
    }
}

int pthread_mutex_timedlock(pthread_mutex_t *mutex, const struct timespec *until)
{
    if (!real)
        begin();
    if (!offset)
        return real_mutex(mutex, until);
    for (;;) {
        struct timespec next = slice(until);
        int code = real_mutex(mutex, &next);
        if (code != ETIMEDOUT || over(until))
            return code;
    }
}

int gettimeofday(struct timeval *now, void *zone)
{
    struct timespec t;
    (void)zone;
    clock_gettime(CLOCK_REALTIME, &t);
    now->tv_sec = t.tv_sec;
    now->tv_usec = t.tv_nsec / 1000;
    return 0;
}

time_t time(time_t *out)
{
    struct timespec t;
    clock_gettime(CLOCK_REALTIME, &t);
    if (out)
        *out = t.tv_sec;
    return t.tv_sec;
}
