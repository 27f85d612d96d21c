/* Lets the clocks of a program go slower, and its waits last longer: preloaded by `slow_clock`.

   A clock that has gone on by t since its origin says origin + rate * t; what waits until a time of
   such a clock waits until the real one is there.  Clocks of CPU time go slower as well.  All
   processes of a program inherit rate and origins, so their clocks agree. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <limits.h>
#include <linux/futex.h>
#include <poll.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/epoll.h>
#include <sys/resource.h>
#include <sys/select.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/timerfd.h>
#include <time.h>
#include <unistd.h>

#define SECOND 1000000000LL
#define LONGEST (INT64_MAX / 4)
/* Times of the monotonic clock, seconds, are smaller, those of the other one larger. */
#define LEAST_REAL_TIME 1000000000LL

static double rate = 1;
static int64_t origin_of_monotonic, origin_of_real_time;

#define REAL(name) ((typeof(&name))real(#name))

static void *real(const char *name) {
  void *found = dlsym(RTLD_NEXT, name);
  if (!found) abort();
  return found;
}

/* Waits without an end are as long as what the type holds, and stay so. */
static int64_t saturated(double ns) { return ns < (double)LONGEST ? (int64_t)ns : LONGEST; }

static int64_t ns_of(const struct timespec *time) {
  return saturated((double)time->tv_sec * SECOND) + time->tv_nsec;
}

static struct timespec timespec_of(int64_t ns) {
  if (ns < 0) ns = 0;
  return (struct timespec){ns / SECOND, ns % SECOND};
}

static int raw_clock(clockid_t clock, struct timespec *time) {
  static int (*real_clock)(clockid_t, struct timespec *);
  if (!real_clock) real_clock = REAL(clock_gettime);
  return real_clock(clock, time);
}

__attribute__((constructor)) static void begin(void) {
  const char *text = getenv("SLOW_CLOCK");
  if (!text) return;
  char *end;
  rate = strtod(text, &end);
  origin_of_monotonic = strtoll(end, &end, 10);
  origin_of_real_time = strtoll(end, &end, 10);
}

static int is_of_cpu(clockid_t clock) {
  return clock < 0 || clock == CLOCK_PROCESS_CPUTIME_ID || clock == CLOCK_THREAD_CPUTIME_ID;
}

static int64_t origin_of(clockid_t clock) {
  int is_real = clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE;
  return is_of_cpu(clock) ? 0 : is_real ? origin_of_real_time : origin_of_monotonic;
}

static int64_t slowed(clockid_t clock, int64_t ns) {
  int64_t origin = origin_of(clock);
  return origin + (int64_t)(rate * (double)(ns - origin));
}

/* The real time at which a slowed clock shows a time. */
static struct timespec real_time_of(clockid_t clock, const struct timespec *time) {
  int64_t origin = origin_of(clock);
  return timespec_of(origin + saturated((double)(ns_of(time) - origin) / rate));
}

static struct timespec longer(const struct timespec *span) {
  return timespec_of(saturated((double)ns_of(span) / rate));
}

static int longer_ms(int ms) {
  double longer = ms / rate + 0.5;
  return ms <= 0 ? ms : longer < INT_MAX ? (int)longer : INT_MAX;
}

/* Clocks. */

int clock_gettime(clockid_t clock, struct timespec *time) {
  int result = raw_clock(clock, time);
  if (!result) *time = timespec_of(slowed(clock, ns_of(time)));
  return result;
}

int gettimeofday(struct timeval *time, void *zone) {
  struct timespec now;
  (void)zone;
  clock_gettime(CLOCK_REALTIME, &now);
  *time = (struct timeval){now.tv_sec, now.tv_nsec / 1000};
  return 0;
}

time_t time(time_t *result) {
  struct timespec now;
  clock_gettime(CLOCK_REALTIME, &now);
  if (result) *result = now.tv_sec;
  return now.tv_sec;
}

int getrusage(__rusage_who_t who, struct rusage *usage) {
  int result = REAL(getrusage)(who, usage);
  struct timeval *times[] = {&usage->ru_utime, &usage->ru_stime};
  for (int i = 0; !result && i < 2; i++) {
    int64_t us = (int64_t)(rate * (double)(times[i]->tv_sec * 1000000LL + times[i]->tv_usec));
    *times[i] = (struct timeval){us / 1000000, us % 1000000};
  }
  return result;
}

/* Waits for so long. */

int nanosleep(const struct timespec *span, struct timespec *left) {
  struct timespec longer_span = longer(span);
  int result = REAL(nanosleep)(&longer_span, left);
  if (result && left) *left = timespec_of((int64_t)(rate * (double)ns_of(left)));
  return result;
}

int usleep(useconds_t us) {
  struct timespec span = timespec_of(us * 1000LL);
  return nanosleep(&span, NULL);
}

unsigned sleep(unsigned seconds) {
  struct timespec span = timespec_of(seconds * SECOND);
  return nanosleep(&span, NULL) ? 1 : 0;
}

int poll(struct pollfd *files, nfds_t count, int ms) {
  return REAL(poll)(files, count, longer_ms(ms));
}

int ppoll(struct pollfd *files, nfds_t count, const struct timespec *span, const sigset_t *mask) {
  struct timespec longer_span;
  if (span) longer_span = longer(span);
  return REAL(ppoll)(files, count, span ? &longer_span : NULL, mask);
}

int select(int count, fd_set *in, fd_set *out, fd_set *bad, struct timeval *span) {
  struct timespec longer_span;
  if (span) {
    struct timespec asked = {span->tv_sec, span->tv_usec * 1000};
    longer_span = longer(&asked);
  }
  return REAL(pselect)(count, in, out, bad, span ? &longer_span : NULL, NULL);
}

int pselect(int count, fd_set *in, fd_set *out, fd_set *bad, const struct timespec *span,
            const sigset_t *mask) {
  struct timespec longer_span;
  if (span) longer_span = longer(span);
  return REAL(pselect)(count, in, out, bad, span ? &longer_span : NULL, mask);
}

int epoll_wait(int file, struct epoll_event *events, int most, int ms) {
  return REAL(epoll_wait)(file, events, most, longer_ms(ms));
}

int epoll_pwait(int file, struct epoll_event *events, int most, int ms, const sigset_t *mask) {
  return REAL(epoll_pwait)(file, events, most, longer_ms(ms), mask);
}

/* Waits until a time. */

int clock_nanosleep(clockid_t clock, int flags, const struct timespec *time,
                    struct timespec *left) {
  int is_absolute = flags & TIMER_ABSTIME;
  struct timespec until = is_absolute ? real_time_of(clock, time) : longer(time);
  return REAL(clock_nanosleep)(clock, flags, &until, left);
}

int sem_timedwait(sem_t *semaphore, const struct timespec *time) {
  struct timespec until = real_time_of(CLOCK_REALTIME, time);
  return REAL(sem_timedwait)(semaphore, &until);
}

int sem_clockwait(sem_t *semaphore, clockid_t clock, const struct timespec *time) {
  struct timespec until = real_time_of(clock, time);
  return REAL(sem_clockwait)(semaphore, clock, &until);
}

int pthread_cond_timedwait(pthread_cond_t *condition, pthread_mutex_t *mutex,
                           const struct timespec *time) {
  clockid_t clock = time->tv_sec < LEAST_REAL_TIME ? CLOCK_MONOTONIC : CLOCK_REALTIME;
  struct timespec until = real_time_of(clock, time);
  return REAL(pthread_cond_timedwait)(condition, mutex, &until);
}

int pthread_cond_clockwait(pthread_cond_t *condition, pthread_mutex_t *mutex, clockid_t clock,
                           const struct timespec *time) {
  struct timespec until = real_time_of(clock, time);
  return REAL(pthread_cond_clockwait)(condition, mutex, clock, &until);
}

int timerfd_settime(int file, int flags, const struct itimerspec *timer, struct itimerspec *old) {
  int is_absolute = flags & TFD_TIMER_ABSTIME;
  struct itimerspec slow = {
      longer(&timer->it_interval),
      is_absolute ? real_time_of(CLOCK_MONOTONIC, &timer->it_value) : longer(&timer->it_value)};
  return REAL(timerfd_settime)(file, flags, &slow, old);
}

/* Rust waits by the system call. */
long syscall(long number, ...) {
  static long (*real_syscall)(long, ...);
  long a[6];
  va_list rest;
  va_start(rest, number);
  for (int i = 0; i < 6; i++) a[i] = va_arg(rest, long);
  va_end(rest);
  if (!real_syscall) real_syscall = (long (*)(long, ...))real("syscall");
  struct timespec until;
  int command = (int)a[1] & ~(FUTEX_PRIVATE_FLAG | FUTEX_CLOCK_REALTIME);
  const struct timespec *time = (const struct timespec *)a[3];
  if (number == SYS_futex && time && (command == FUTEX_WAIT || command == FUTEX_WAIT_BITSET)) {
    clockid_t clock = a[1] & FUTEX_CLOCK_REALTIME ? CLOCK_REALTIME : CLOCK_MONOTONIC;
    until = command == FUTEX_WAIT ? longer(time) : real_time_of(clock, time);
    a[3] = (long)&until;
  }
  return real_syscall(number, a[0], a[1], a[2], a[3], a[4], a[5]);
}
