/* Makes one call of the system fail that changes files below a folder: to be preloaded, see tests/faults. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

enum { OFF, ERROR, KILL };
static char below[PATH_MAX] = "";
static int mode = OFF, wanted = 0, seen = 0;
static char last[64] = "";

/* Counts from now on; the call of that number fails, or ends the process. 0: none does. */
void faults_arm(const char *folder, int number, int how) {
    snprintf(below, sizeof below, "%s", folder);
    wanted = number, mode = how, seen = 0;
}
int faults_seen(void) { return seen; }
const char *faults_last(void) { return last; }

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

/* Whether this call is the one that fails. */
static int fails(const char *name) {
    if (__sync_add_and_fetch(&seen, 1) != wanted) return 0;
    snprintf(last, sizeof last, "%s", name);
    return 1;
}
static int end(int code) {
    if (mode == KILL) _exit(137);
    errno = code;
    return -1;
}

#define REAL(name) __typeof__(&name) real = (__typeof__(&name))dlsym(RTLD_NEXT, #name)

/* A write that fails has written half of it. */
ssize_t write(int handle, const void *data, size_t size) {
    REAL(write);
    if (of_handle(handle) && fails("write")) { (void)!real(handle, data, size / 2); return end(ENOSPC); }
    return real(handle, data, size);
}
ssize_t pwrite64(int handle, const void *data, size_t size, off64_t at) {
    REAL(pwrite64);
    if (of_handle(handle) && fails("pwrite")) { (void)!real(handle, data, size / 2, at); return end(ENOSPC); }
    return real(handle, data, size, at);
}
ssize_t writev(int handle, const struct iovec *parts, int count) {
    REAL(writev);
    if (of_handle(handle) && fails("writev")) { (void)!real(handle, parts, count / 2); return end(ENOSPC); }
    return real(handle, parts, count);
}
int fsync(int handle) { REAL(fsync); return of_handle(handle) && fails("fsync") ? end(EIO) : real(handle); }
int fdatasync(int handle) { REAL(fdatasync); return of_handle(handle) && fails("fdatasync") ? end(EIO) : real(handle); }
int close(int handle) {
    REAL(close);
    /* where a network file system says that the disk is full; asked of what may be written to alone */
    if (of_handle(handle) && (fcntl(handle, F_GETFL) & O_ACCMODE) != O_RDONLY && fails("close")) {
        real(handle);
        return end(ENOSPC);
    }
    return real(handle);
}
int rename(const char *from, const char *to) {
    REAL(rename);
    return of_path(AT_FDCWD, to) && fails("rename") ? end(EIO) : real(from, to);
}
int renameat(int a, const char *from, int b, const char *to) {
    REAL(renameat);
    return of_path(b, to) && fails("rename") ? end(EIO) : real(a, from, b, to);
}
int mkdir(const char *path, mode_t bits) {
    REAL(mkdir);
    return of_path(AT_FDCWD, path) && fails("mkdir") ? end(ENOSPC) : real(path, bits);
}
int unlink(const char *path) {
    REAL(unlink);
    return of_path(AT_FDCWD, path) && fails("unlink") ? end(EIO) : real(path);
}
int unlinkat(int folder, const char *path, int flags) {
    REAL(unlinkat);
    return of_path(folder, path) && fails("unlink") ? end(EIO) : real(folder, path, flags);
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
        if ((flags & O_CREAT) && of_path(folder, path) && fails("open")) return end(ENOSPC); \
        return real given;                                                          \
    }
OPENED(open, (const char *path, int flags, ...), (path, flags, bits), AT_FDCWD)
OPENED(open64, (const char *path, int flags, ...), (path, flags, bits), AT_FDCWD)
OPENED(openat, (int folder, const char *path, int flags, ...), (folder, path, flags, bits), folder)
OPENED(openat64, (int folder, const char *path, int flags, ...), (folder, path, flags, bits), folder)
