/* Makes one call of the system fail that changes files below a folder: to be preloaded, see tests/faults. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <unistd.h>

static char below[PATH_MAX] = "";
static enum { COUNTS, STOPS, FORKS } does = COUNTS;
static int wanted = 0, seen = 0, asks = -1, answers = -1;
static pthread_mutex_t one_at_a_time = PTHREAD_MUTEX_INITIALIZER;

static void begin(const char *folder, int asking, int answering) {
    snprintf(below, sizeof below, "%s", folder);
    wanted = seen = 0, asks = asking, answers = answering;
}
/* Stops at every call below a folder, a write half done: says so by a number, and goes on when one comes. */
void faults_stop_at_each(const char *folder, int asking, int answering) {
    begin(folder, asking, answering);
    does = STOPS;
}
/* Stops at the first call below a folder. For each number that comes a fork goes on from there, in which the call of
   that number fails; its process and then how it ended are the answer. */
void faults_fork_at_first(const char *folder, int asking, int answering) {
    begin(folder, asking, answering);
    does = FORKS;
}
int faults_wanted(void) { return wanted; }
/* Returns how many calls there were, and counts no more. */
int faults_end(void) {
    *below = 0;
    return seen;
}

static int is_below(const char *path) { return *below && path && strncmp(path, below, strlen(below)) == 0; }

static int of_path(int folder, const char *path) {
    char whole[2 * PATH_MAX], link[64], base[PATH_MAX];
    if (!*below || !path) return 0;
    if (*path == '/') return is_below(path);
    if (folder == AT_FDCWD) {
        if (!getcwd(base, sizeof base)) return 0;
    } else {
        snprintf(link, sizeof link, "/proc/self/fd/%d", folder);
        ssize_t n = readlink(link, base, sizeof base - 1);
        if (n < 0) return 0;
        base[n] = 0;
    }
    snprintf(whole, sizeof whole, "%s/%s", base, path);
    return is_below(whole);
}

static int of_handle(int handle) {
    char link[64], base[PATH_MAX];
    if (!*below) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", handle);
    ssize_t n = readlink(link, base, sizeof base - 1);
    if (n < 0) return 0;
    base[n] = 0;
    return is_below(base);
}

#define REAL(name) __typeof__(&name) real = (__typeof__(&name))dlsym(RTLD_NEXT, #name)

static int error(int code) { errno = code; return -1; }
static void say(int number) {
    REAL(write);
    if (real(asks, &number, sizeof number) != sizeof number) _exit(98);
}
static int hear(void) {
    int number = 0;
    return read(answers, &number, sizeof number) == sizeof number ? number : 0;
}
static void fork_for_each(void) {
    while ((wanted = hear())) {
        int child = fork(), status = 0;
        if (child == 0) return;
        say(child);
        waitpid(child, &status, 0);
        say(status);
    }
    _exit(0);
}
static int is_wanted(void) {
    if (does == FORKS && seen == 0) fork_for_each();
    return __sync_add_and_fetch(&seen, 1) == wanted;
}
static void stop(void) {
    if (does != STOPS) return;
    pthread_mutex_lock(&one_at_a_time);
    say(seen);
    hear();
    pthread_mutex_unlock(&one_at_a_time);
}
/* Whether this call, of those that do nothing by halves, is the one that fails. */
static int fails(void) {
    int wanted_now = is_wanted();
    stop();
    return wanted_now;
}

/* A write that fails, or at which the process stops, has written half of it. */
#define IN_HALVES(whole, first, second)               \
    if (!of_handle(handle)) return whole;             \
    int fails_now = is_wanted();                      \
    ssize_t half = first;                             \
    stop();                                           \
    if (fails_now) return error(ENOSPC);              \
    ssize_t rest = half < 0 ? half : second;          \
    return rest < 0 ? rest : half + rest;

ssize_t write(int handle, const void *data, size_t size) {
    REAL(write);
    IN_HALVES(real(handle, data, size), real(handle, data, size / 2), real(handle, data + half, size - half))
}
ssize_t pwrite64(int handle, const void *data, size_t size, off64_t at) {
    REAL(pwrite64);
    IN_HALVES(real(handle, data, size, at), real(handle, data, size / 2, at),
              real(handle, data + half, size - half, at + half))
}
ssize_t writev(int handle, const struct iovec *parts, int count) {
    REAL(writev);
    int few = count / 2;
    IN_HALVES(real(handle, parts, count), real(handle, parts, few), real(handle, parts + few, count - few))
}
int fsync(int handle) { REAL(fsync); return of_handle(handle) && fails() ? error(EIO) : real(handle); }
int fdatasync(int handle) { REAL(fdatasync); return of_handle(handle) && fails() ? error(EIO) : real(handle); }
int close(int handle) {
    REAL(close);
    /* where a network file system says that the disk is full; asked of what may be written to alone */
    if (of_handle(handle) && (fcntl(handle, F_GETFL) & O_ACCMODE) != O_RDONLY && fails()) {
        real(handle);
        return error(ENOSPC);
    }
    return real(handle);
}
int rename(const char *from, const char *to) {
    REAL(rename);
    return of_path(AT_FDCWD, to) && fails() ? error(EIO) : real(from, to);
}
int renameat(int a, const char *from, int b, const char *to) {
    REAL(renameat);
    return of_path(b, to) && fails() ? error(EIO) : real(a, from, b, to);
}
int mkdir(const char *path, mode_t bits) {
    REAL(mkdir);
    return of_path(AT_FDCWD, path) && fails() ? error(ENOSPC) : real(path, bits);
}
int unlink(const char *path) {
    REAL(unlink);
    return of_path(AT_FDCWD, path) && fails() ? error(EIO) : real(path);
}
int unlinkat(int folder, const char *path, int flags) {
    REAL(unlinkat);
    return of_path(folder, path) && fails() ? error(EIO) : real(folder, path, flags);
}

#define OPENED(name, declared, given, folder)                                       \
    int name declared {                                                             \
        REAL(name);                                                                 \
        mode_t bits = 0;                                                            \
        if (flags & (O_CREAT | O_TMPFILE)) {                                        \
            va_list more;                                                           \
            va_start(more, flags);                                                  \
            bits = va_arg(more, mode_t);                                            \
            va_end(more);                                                           \
        }                                                                           \
        if ((flags & O_CREAT) && of_path(folder, path) && fails()) return error(ENOSPC); \
        return real given;                                                          \
    }
OPENED(open, (const char *path, int flags, ...), (path, flags, bits), AT_FDCWD)
OPENED(open64, (const char *path, int flags, ...), (path, flags, bits), AT_FDCWD)
OPENED(openat, (int folder, const char *path, int flags, ...), (folder, path, flags, bits), folder)
OPENED(openat64, (int folder, const char *path, int flags, ...), (folder, path, flags, bits), folder)
