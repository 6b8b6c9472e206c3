/* Included before loop.c: main becomes loop_main, which takes time, packets and priority from a test. */
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <errno.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

static long long (*sleep_until)(long long);      /* ns; returns the time at which the sleep ends */
static long (*receive)(void *bytes, long size);  /* returns the size of a packet, or -errno */
static void (*deliver)(const void *bytes, long size);
static int priority_result;
static long long simulated_now;
char printed[1000], warned[1000];

int loop_main(int count, char **words);

/* Runs the program from time 0 with these functions and this result of sched_setscheduler; returns its exit code. */
int loop_run(long long (*sleeps)(long long), long (*receives)(void *, long), void (*delivers)(const void *, long), int priority)
{
    char *words[] = { "loop", "1" };
    sleep_until = sleeps, receive = receives, deliver = delivers, priority_result = priority;
    simulated_now = printed[0] = warned[0] = 0;
    return loop_main(2, words);
}

static int simulated_clock(struct timespec *now)
{
    now->tv_sec = simulated_now / 1000000000LL;
    now->tv_nsec = simulated_now % 1000000000LL;
    return 0;
}

static int simulated_sleep(const struct timespec *until)
{
    simulated_now = sleep_until(until->tv_sec * 1000000000LL + until->tv_nsec);
    return 0;
}

static long simulated_receive(void *bytes, size_t room)
{
    long size = receive(bytes, (long)room);
    if (size >= 0) return size;
    errno = (int)-size;
    return -1;
}

#define main loop_main
#define socket(...) 3
#define connect(...) 0
#define clock_gettime(clock, now) simulated_clock(now)
#define clock_nanosleep(clock, how, until, left) simulated_sleep(until)
#define recv(line, bytes, size, flags) simulated_receive(bytes, size)
#define send(line, bytes, size, flags) deliver(bytes, (long)(size))
#define sched_setscheduler(...) priority_result
#define mlockall(...) 0
#define printf(...) snprintf(printed, sizeof printed, __VA_ARGS__)
#define fprintf(stream, ...) snprintf(warned, sizeof warned, __VA_ARGS__)
