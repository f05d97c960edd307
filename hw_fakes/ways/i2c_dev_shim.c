/* Loaded into a program by LD_PRELOAD: its /dev/i2c-N is the fake behind a socket (hw_fakes/preload.py).
 *
 * HW_FAKES_I2C_BUS is N, HW_FAKES_I2C_SOCKET the socket. Each open() is a SOCK_SEQPACKET connection of its own, and its
 * descriptor is what the program gets. A request is one packet {u32 operation, a, b, c; bytes}, the reply one packet
 * {i32 result or negative errno; bytes}. To whoever looks without opening, the device is /dev/null with the number of
 * an I2C device. Needs glibc 2.33 or newer; system calls made without the C library are not seen. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/i2c-dev.h>
#include <linux/i2c.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <sys/un.h>
#include <sys/xattr.h>
#include <unistd.h>

enum { CONTROL, SMBUS, TRANSFER, READ, WRITE }; /* as in preload.py */
enum { MOST_FILES = 4096, MOST_BYTES = 8192, MOST_PAYLOAD = 65536, I2C_MAJOR = 89 };
/* The C library's own; two threads that look it up at once find the same. */
#define LIBC(name) ({ static __typeof__(&name) kept; \
	kept = kept ? kept : (__typeof__(&name))dlsym(RTLD_NEXT, #name); kept; })

static ino_t socket_of[MOST_FILES]; /* 0 where the descriptor is not ours */
static unsigned char packet[16 + MOST_PAYLOAD];
static pthread_mutex_t packet_mutex = PTHREAD_MUTEX_INITIALIZER;

static int is_device(const char *path)
{
	const char *bus = getenv("HW_FAKES_I2C_BUS");
	char device[32];
	if (!bus || !path) return 0;
	snprintf(device, sizeof device, "/dev/i2c-%s", bus);
	return !strcmp(path, device);
}

static int is_ours(int fd)
{
	struct stat now;
	if (fd < 0 || fd >= MOST_FILES || !socket_of[fd]) return 0;
	/* The number may have been closed behind our back (dup2, close_range) and stand for another file by now. */
	if (!LIBC(fstat)(fd, &now) && S_ISSOCK(now.st_mode) && now.st_ino == socket_of[fd]) return 1;
	socket_of[fd] = 0;
	return 0;
}

/* Sends `length` bytes that stand at packet + 16; the answer's bytes stand at packet + 4. Returns the result or -1. */
static int call(int fd, uint32_t operation, uint32_t a, uint32_t b, uint32_t c, size_t length, size_t *answered)
{
	uint32_t head[4] = { operation, a, b, c };
	int32_t result;
	ssize_t n;
	memcpy(packet, head, sizeof head);
	do n = send(fd, packet, sizeof head + length, MSG_NOSIGNAL); while (n < 0 && errno == EINTR);
	if (n >= 0) do n = recv(fd, packet, sizeof packet, 0); while (n < 0 && errno == EINTR);
	if (n < (ssize_t)sizeof result) { errno = ENODEV; return -1; } /* the server is gone */
	memcpy(&result, packet, sizeof result);
	if (result < 0) { errno = -result; return -1; }
	*answered = n - sizeof result;
	return result;
}

static int open_device(int flags)
{
	struct sockaddr_un name = { .sun_family = AF_UNIX };
	struct stat made;
	const char *path = getenv("HW_FAKES_I2C_SOCKET");
	int fd = socket(AF_UNIX, SOCK_SEQPACKET | (flags & O_CLOEXEC ? SOCK_CLOEXEC : 0), 0);
	if (fd < 0) return -1;
	snprintf(name.sun_path, sizeof name.sun_path, "%s", path ? path : "");
	if (fd >= MOST_FILES || connect(fd, (void *)&name, sizeof name) || LIBC(fstat)(fd, &made)) {
		LIBC(close)(fd);
		errno = ENODEV;
		return -1;
	}
	socket_of[fd] = made.st_ino;
	return fd;
}

static int smbus(int fd, struct i2c_smbus_ioctl_data *asked)
{
	size_t length = 0, answered;
	if (asked->size != I2C_SMBUS_QUICK && !(asked->size == I2C_SMBUS_BYTE && asked->read_write == I2C_SMBUS_WRITE)) {
		if (!asked->data) { errno = EINVAL; return -1; }
		length = asked->size <= I2C_SMBUS_BYTE_DATA ? 1 : asked->size <= I2C_SMBUS_PROC_CALL ? 2 : sizeof *asked->data;
		memcpy(packet + 16, asked->data, length);
	}
	if (call(fd, SMBUS, asked->read_write, asked->command, asked->size, length, &answered) < 0) return -1;
	if (length) memcpy(asked->data, packet + 4, answered < length ? answered : length);
	return 0;
}

static int transfer(int fd, struct i2c_rdwr_ioctl_data *asked)
{
	unsigned char *at = packet + 16;
	size_t sent = 0, wanted = 0, answered;
	int done;
	if (!asked->nmsgs || asked->nmsgs > I2C_RDWR_IOCTL_MAX_MSGS) { errno = EINVAL; return -1; }
	for (unsigned i = 0; i < asked->nmsgs; i++) {
		struct i2c_msg *m = asked->msgs + i;
		uint16_t head[3] = { m->addr, m->flags, m->len };
		int reads = m->flags & I2C_M_RD;
		sent += sizeof head + (reads ? 0 : m->len);
		wanted += reads ? m->len : 0;
		if (m->len > MOST_BYTES || sent > MOST_PAYLOAD || wanted > MOST_PAYLOAD) { errno = EINVAL; return -1; }
		memcpy(at, head, sizeof head);
		at += sizeof head;
		if (!reads) { memcpy(at, m->buf, m->len); at += m->len; }
	}
	done = call(fd, TRANSFER, asked->nmsgs, 0, 0, sent, &answered);
	if (done < 0) return -1;
	if (answered != wanted) { errno = EIO; return -1; }
	at = packet + 4;
	for (unsigned i = 0; i < asked->nmsgs; i++) {
		struct i2c_msg *m = asked->msgs + i;
		if (m->flags & I2C_M_RD) { memcpy(m->buf, at, m->len); at += m->len; }
	}
	return done;
}

int ioctl(int fd, unsigned long request, ...)
{
	va_list rest;
	void *argument;
	size_t answered;
	int result;
	va_start(rest, request);
	argument = va_arg(rest, void *);
	va_end(rest);
	if (!is_ours(fd)) return LIBC(ioctl)(fd, request, argument);
	pthread_mutex_lock(&packet_mutex);
	if (request == I2C_SMBUS) result = smbus(fd, argument);
	else if (request == I2C_RDWR) result = transfer(fd, argument);
	else result = call(fd, CONTROL, request, (uintptr_t)argument, 0, 0, &answered);
	pthread_mutex_unlock(&packet_mutex);
	if (request == I2C_FUNCS && result >= 0) { *(unsigned long *)argument = result; return 0; }
	return result;
}

ssize_t read(int fd, void *buffer, size_t n)
{
	size_t answered;
	int result;
	if (!is_ours(fd)) return LIBC(read)(fd, buffer, n);
	pthread_mutex_lock(&packet_mutex);
	result = call(fd, READ, n < MOST_BYTES ? n : MOST_BYTES, 0, 0, 0, &answered);
	if (result >= 0) memcpy(buffer, packet + 4, answered);
	pthread_mutex_unlock(&packet_mutex);
	return result < 0 ? -1 : (ssize_t)answered;
}

ssize_t __read_chk(int fd, void *buffer, size_t n, size_t size)
{
	if (n > size) abort();
	return read(fd, buffer, n);
}

ssize_t write(int fd, const void *buffer, size_t n)
{
	size_t answered;
	int result;
	if (!is_ours(fd)) return LIBC(write)(fd, buffer, n);
	pthread_mutex_lock(&packet_mutex);
	if (n > MOST_BYTES) n = MOST_BYTES;
	memcpy(packet + 16, buffer, n);
	result = call(fd, WRITE, 0, 0, 0, n, &answered);
	pthread_mutex_unlock(&packet_mutex);
	return result;
}

int close(int fd)
{
	if (fd >= 0 && fd < MOST_FILES) socket_of[fd] = 0;
	return LIBC(close)(fd);
}

#define MODE(flags) ({ mode_t mode = 0; if (flags & O_CREAT || (flags & O_TMPFILE) == O_TMPFILE) { \
	va_list rest; va_start(rest, flags); mode = va_arg(rest, mode_t); va_end(rest); } mode; })
#define OPENS(name) int name(const char *path, int flags, ...) \
	{ return is_device(path) ? open_device(flags) : LIBC(name)(path, flags, MODE(flags)); }
#define OPENS_AT(name) int name(int folder, const char *path, int flags, ...) \
	{ return is_device(path) ? open_device(flags) : LIBC(name)(folder, path, flags, MODE(flags)); }
OPENS(open)
OPENS(open64)
OPENS_AT(openat)
OPENS_AT(openat64)
/* What open() is in programs built with _FORTIFY_SOURCE. */
int __open_2(const char *path, int flags) { return open(path, flags); }
int __open64_2(const char *path, int flags) { return open64(path, flags); }
int __openat_2(int folder, const char *path, int flags) { return openat(folder, path, flags); }
int __openat64_2(int folder, const char *path, int flags) { return openat64(folder, path, flags); }

static dev_t number(void) { return makedev(I2C_MAJOR, atoi(getenv("HW_FAKES_I2C_BUS"))); }
#define LOOKS(name, type) int name(const char *path, struct type *found) { \
	int ours = is_device(path), result = LIBC(name)(ours ? "/dev/null" : path, found); \
	if (ours && !result) found->st_rdev = number(); \
	return result; }
#define LOOKS_AT(name, type) int name(int folder, const char *path, struct type *found, int flags) { \
	int ours = is_device(path), result = LIBC(name)(folder, ours ? "/dev/null" : path, found, flags); \
	if (ours && !result) found->st_rdev = number(); \
	return result; }
#define LOOKS_OPEN(name, look, type) int name(int fd, struct type *found) \
	{ return is_ours(fd) ? look("/dev/null", found) || (found->st_rdev = number(), 0) : LIBC(name)(fd, found); }
LOOKS(stat, stat)
LOOKS(lstat, stat)
LOOKS(stat64, stat64)
LOOKS(lstat64, stat64)
LOOKS_AT(fstatat, stat)
LOOKS_AT(fstatat64, stat64)
LOOKS_OPEN(fstat, stat, stat)
LOOKS_OPEN(fstat64, stat64, stat64)
int statx(int folder, const char *path, int flags, unsigned mask, struct statx *found)
{
	int ours = is_device(path), result = LIBC(statx)(folder, ours ? "/dev/null" : path, flags, mask, found);
	if (ours && !result) { found->stx_rdev_major = major(number()); found->stx_rdev_minor = minor(number()); }
	return result;
}
int access(const char *path, int mode) { return LIBC(access)(is_device(path) ? "/dev/null" : path, mode); }
int faccessat(int folder, const char *path, int mode, int flags)
	{ return LIBC(faccessat)(folder, is_device(path) ? "/dev/null" : path, mode, flags); }
/* ls -l looks for access lists. */
#define HAS_NONE(name) ssize_t name(const char *path, const char *attribute, void *value, size_t size) \
	{ return LIBC(name)(is_device(path) ? "/dev/null" : path, attribute, value, size); }
HAS_NONE(getxattr)
HAS_NONE(lgetxattr)
