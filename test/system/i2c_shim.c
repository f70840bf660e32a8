/* Puts a simulated I2C bus behind /dev/i2c-N: preloaded into a program, it answers the program's
 * open and ioctl calls on such a file through the Unix socket $I2C_SIMULATOR/i2c-N.
 *
 * Each ioctl is one packet there and one back; the answer begins with an errno, 0 for success.
 * Compiled by the tests: cc -shared -fPIC -o i2c_shim.so i2c_shim.c -ldl
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/i2c-dev.h>
#include <linux/i2c.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/types.h>
#include <sys/un.h>
#include <unistd.h>

#define DEVICE "/dev/i2c-"
#define FILES 1024
#define PACKET 16384

static unsigned char simulated[FILES]; /* whether a file descriptor is a bus */
static uint16_t address_of[FILES];     /* what I2C_SLAVE set */

static int is_bus(int fd) { return fd >= 0 && fd < FILES && simulated[fd]; }

static int fail(int error)
{
    errno = error;
    return -1;
}

/* Send a packet and receive the answer; its length without the errno, or -1. */
static ssize_t ask(int fd, const void *packet, size_t length, void *answer, size_t size)
{
    static __thread unsigned char buffer[PACKET];
    ssize_t received;
    int32_t error;

    if (packet && send(fd, packet, length, MSG_NOSIGNAL) < 0)
        return fail(ENODEV);
    do
        received = recv(fd, buffer, sizeof buffer, 0);
    while (received < 0 && errno == EINTR);
    if (received < (ssize_t)sizeof error)
        return fail(ENODEV);
    memcpy(&error, buffer, sizeof error);
    if (error)
        return fail(error);
    received -= sizeof error;
    if ((size_t)received > size)
        return fail(EPROTO);
    memcpy(answer, buffer + sizeof error, received);
    return received;
}

static int open_bus(const char *path)
{
    struct sockaddr_un name = {.sun_family = AF_UNIX};
    const char *folder = getenv("I2C_SIMULATOR");
    int fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);

    if (fd < 0)
        return -1;
    snprintf(name.sun_path, sizeof name.sun_path, "%s/%s", folder, path + strlen("/dev/"));
    if (fd >= FILES || connect(fd, (struct sockaddr *)&name, sizeof name) < 0) {
        close(fd);
        return fail(ENOENT);
    }
    if (ask(fd, NULL, 0, NULL, 0) < 0) { /* may it be opened? */
        int error = errno;
        close(fd);
        return fail(error);
    }
    simulated[fd] = 1;
    return fd;
}

static int transfer(int fd, struct i2c_rdwr_ioctl_data *data)
{
    unsigned char packet[PACKET], answer[PACKET], *to = packet, *from = answer;

    *to++ = 'R';
    *to++ = data->nmsgs;
    for (unsigned i = 0; i < data->nmsgs; i++) {
        struct i2c_msg *message = &data->msgs[i];
        uint16_t head[3] = {message->addr, message->flags, message->len};
        size_t length = message->flags & I2C_M_RD ? 0 : message->len;

        if (to + sizeof head + length > packet + sizeof packet)
            return fail(EINVAL);
        memcpy(to, head, sizeof head);
        memcpy(to + sizeof head, message->buf, length);
        to += sizeof head + length;
    }
    if (ask(fd, packet, to - packet, answer, sizeof answer) < 0)
        return -1;
    for (unsigned i = 0; i < data->nmsgs; i++)
        if (data->msgs[i].flags & I2C_M_RD) {
            memcpy(data->msgs[i].buf, from, data->msgs[i].len);
            from += data->msgs[i].len;
        }
    return data->nmsgs;
}

static int smbus(int fd, struct i2c_smbus_ioctl_data *data)
{
    union i2c_smbus_data none = {0}, *block = data->data ? data->data : &none;
    unsigned char packet[9 + sizeof *block];

    packet[0] = 'S';
    memcpy(packet + 1, &address_of[fd], 2);
    packet[3] = data->read_write;
    packet[4] = data->command;
    memcpy(packet + 5, &data->size, 4);
    memcpy(packet + 9, block, sizeof *block);
    return ask(fd, packet, sizeof packet, block, sizeof *block) < 0 ? -1 : 0;
}

int ioctl(int fd, unsigned long request, ...)
{
    static int (*next)(int, unsigned long, ...);
    va_list arguments;
    void *argument;
    unsigned char packet[3] = {'A'};

    va_start(arguments, request);
    argument = va_arg(arguments, void *);
    va_end(arguments);
    if (!is_bus(fd)) {
        if (!next)
            next = (int (*)(int, unsigned long, ...))dlsym(RTLD_NEXT, "ioctl");
        return next(fd, request, argument);
    }
    switch (request) {
    case I2C_FUNCS:
        return ask(fd, "F", 1, argument, sizeof(unsigned long)) < 0 ? -1 : 0;
    case I2C_SLAVE:
    case I2C_SLAVE_FORCE:
        address_of[fd] = (uint16_t)(uintptr_t)argument;
        memcpy(packet + 1, &address_of[fd], 2);
        return ask(fd, packet, sizeof packet, NULL, 0) < 0 ? -1 : 0;
    case I2C_RDWR:
        return transfer(fd, argument);
    case I2C_SMBUS:
        return smbus(fd, argument);
    default:
        return fail(ENOTTY);
    }
}

int close(int fd)
{
    static int (*next)(int);

    if (!next)
        next = (int (*)(int))dlsym(RTLD_NEXT, "close");
    if (is_bus(fd))
        simulated[fd] = 0;
    return next(fd);
}

#define OPEN(name, declared, passed, ...)                                                          \
    int name(declared const char *path, int flags, ...)                                            \
    {                                                                                              \
        static int (*next)(__VA_ARGS__ const char *, int, ...);                                    \
        va_list arguments;                                                                         \
        mode_t mode;                                                                               \
                                                                                                   \
        if (strncmp(path, DEVICE, strlen(DEVICE)) == 0 && getenv("I2C_SIMULATOR"))                 \
            return open_bus(path);                                                                 \
        va_start(arguments, flags);                                                                \
        mode = va_arg(arguments, mode_t);                                                          \
        va_end(arguments);                                                                         \
        if (!next)                                                                                 \
            next = (int (*)(__VA_ARGS__ const char *, int, ...))dlsym(RTLD_NEXT, #name);           \
        return next(passed path, flags, mode);                                                     \
    }

#define NOTHING
#define FOLDER_DECLARED int folder,
#define FOLDER_PASSED folder,
OPEN(open, NOTHING, NOTHING, )
OPEN(open64, NOTHING, NOTHING, )
OPEN(openat, FOLDER_DECLARED, FOLDER_PASSED, int, )
OPEN(openat64, FOLDER_DECLARED, FOLDER_PASSED, int, )
