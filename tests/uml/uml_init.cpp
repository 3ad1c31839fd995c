// The first process of the user-mode Linux: sets the machine up as the job folder asks, runs one command,
// writes its exit status into the job folder and switches the machine off.

#include <fcntl.h>
#include <linux/loop.h>
#include <sys/ioctl.h>
#include <sys/mount.h>
#include <sys/reboot.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/utsname.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <initializer_list>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/uml/machine_files.hpp"

namespace {

using namespace fathom::uml;

constexpr const char* kLoopDevice = "/dev/loop0";

std::string job;

std::string inJob(const char* name) {
  return job + "/" + name;
}

bool exists(const std::string& path) {
  return ::access(path.c_str(), F_OK) == 0;
}

[[noreturn]] void fail(const std::string& what) {
  throw std::runtime_error(what + ": " + std::strerror(errno));
}

std::vector<std::string> readList(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::vector<std::string> out;
  for (std::string item; std::getline(in, item, '\0');) out.push_back(item);
  return out;
}

// Writes atomically, since the file is read from outside.
void writeText(const std::string& path, const std::string& text) {
  std::ofstream(path + ".part") << text;
  if (std::rename((path + ".part").c_str(), path.c_str()) != 0) fail(path);
}

void mountAt(const char* what, const std::string& where, const char* type, const char* options = nullptr) {
  if (::mount(what, where.c_str(), type, 0, options) != 0) fail("mount " + where);
}

void insertModule(const std::string& name) {
  utsname kernel = {};
  ::uname(&kernel);
  const std::string path = std::string(kModulesFolder) + "/" + kernel.release + "/kernel/" + name;
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) fail(path);
  if (::syscall(SYS_finit_module, fd, "", 0) != 0) fail(path);
  ::close(fd);
}

std::vector<char*> pointers(std::vector<std::string>& list) {
  std::vector<char*> out;
  for (std::string& item : list) out.push_back(item.data());
  out.push_back(nullptr);
  return out;
}

// The exit status as a shell gives it: 128 and the signal's number for a program that a signal ended.
int waitFor(pid_t child) {
  for (;;) {
    int status = 0;
    const pid_t ended = ::wait(&status);
    if (ended < 0 && errno != EINTR) fail("wait");
    if (ended == child) return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }
}

void run(std::initializer_list<const char*> command) {
  std::vector<std::string> arguments(command.begin(), command.end());
  const pid_t child = ::fork();
  if (child == 0) {
    ::execvp(arguments[0].c_str(), pointers(arguments).data());
    std::fprintf(stderr, "%s: %s\n", arguments[0].c_str(), std::strerror(errno));
    ::_exit(127);
  }
  if (waitFor(child) != 0) throw std::runtime_error(arguments[0] + " failed");
}

// Through hostfs, so that the image's flushes reach the host (uml_drive.cpp).
void attachLoop(const std::string& image) {
  insertModule("drivers/block/loop.ko");
  const int disk = ::open(image.c_str(), O_RDWR | O_CLOEXEC), loop = ::open(kLoopDevice, O_RDWR | O_CLOEXEC);
  if (disk < 0 || loop < 0 || ::ioctl(loop, LOOP_SET_FD, disk) != 0) fail(kLoopDevice);
  ::close(disk);
  ::close(loop);
}

void mountDisk() {
  const char* drive = "/dev/ubda";
  if (exists(inJob(kLoopFile))) {
    drive = kLoopDevice;
    attachLoop(readList(inJob(kLoopFile)).at(0));
  }
  mountAt(drive, inJob(kDiskFolder), "ext4");
}

void setUp() {
  ::setenv("PATH", "/usr/sbin:/usr/bin:/sbin:/bin", 1);
  mountAt("proc", "/proc", "proc");
  mountAt("sysfs", "/sys", "sysfs");
  mountAt("tmpfs", "/run", "tmpfs");
  ::mkdir("/dev/shm", 01777);
  ::mkdir("/dev/pts", 0755);
  mountAt("tmpfs", "/dev/shm", "tmpfs");
  mountAt("devpts", "/dev/pts", "devpts", "ptmxmode=0666");
  run({"ip", "link", "set", "lo", "up"});
  if (exists(inJob(kCanFile))) {
    for (const char* name : {"net/can/can.ko", "net/can/can-raw.ko", "drivers/net/can/dev/can-dev.ko",
                             "drivers/net/can/vcan.ko"})
      insertModule(name);
    for (const char* name : {"vcan0", "vcan1"}) {
      run({"ip", "link", "add", name, "type", "vcan"});
      run({"ip", "link", "set", name, "up"});
    }
  }
  if (exists(inJob(kDiskFolder))) mountDisk();
}

[[noreturn]] void runCommand() {
  const auto redirect = [](const std::string& path, int to) {
    const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0644);
    if (fd >= 0) ::dup2(fd, to);
  };
  ::setsid();
  redirect(inJob(kOutputFile), STDOUT_FILENO);
  redirect(inJob(kErrorsFile), STDERR_FILENO);
  std::vector<std::string> arguments = readList(inJob(kArgumentsFile));
  std::vector<std::string> environment = readList(inJob(kEnvironmentFile));
  if (exists(inJob(kDiskFolder)))
    environment.push_back(std::string(kDiskVariable) + "=" + inJob(kDiskFolder));
  if (::chdir(readList(inJob(kFolderFile)).at(0).c_str()) != 0) fail("working folder");
  ::execvpe(arguments.at(0).c_str(), pointers(arguments).data(), pointers(environment).data());
  std::fprintf(stderr, "%s: %s\n", arguments[0].c_str(), std::strerror(errno));
  ::_exit(127);
}

}  // namespace

int main() {
  const char* folder = std::getenv(kJobVariable);
  if (::getpid() != 1 || folder == nullptr) {
    std::fprintf(stderr, "uml_init is started by uml_run, as the first process of a user-mode Linux\n");
    return 2;
  }
  job = folder;
  try {
    setUp();
    writeText(inJob(kStartedFile), "");
    const pid_t child = ::fork();
    if (child == 0) runCommand();
    const int status = waitFor(child);
    ::sync();
    writeText(inJob(kStatusFile), std::to_string(status));
  } catch (const std::exception& error) {
    std::ofstream(inJob(kFailureFile)) << error.what();
  }
  ::kill(-1, SIGKILL);
  if (exists(inJob(kDiskFolder))) ::umount(inJob(kDiskFolder).c_str());
  ::sync();
  ::reboot(RB_POWER_OFF);
  return 1;
}
