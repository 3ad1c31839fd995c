#pragma once

#include <unistd.h>

#include <cstdint>
#include <filesystem>
#include <fstream>

#include "realtime/base/input_error.hpp"

namespace fathom::fuzz {

// A file with the fuzzer's bytes, in a folder of this process in memory.
class ScratchFile {
 public:
  explicit ScratchFile(const std::string& name)
      : folder_("/dev/shm/fathom-fuzz-" + std::to_string(::getpid())) {
    std::filesystem::create_directories(folder_);
    path_ = folder_ / name;
  }
  ~ScratchFile() { std::filesystem::remove_all(folder_); }
  ScratchFile(const ScratchFile&) = delete;
  ScratchFile& operator=(const ScratchFile&) = delete;

  void write(const std::uint8_t* data, std::size_t size) const {
    std::ofstream(path_, std::ios::binary)
        .write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(size));
  }
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }

 private:
  std::filesystem::path folder_, path_;
};

// Runs `work`, which must succeed or throw an InputError of one line.
template <class Work>
void readsOrRefuses(Work work) {
  try {
    work();
  } catch (const InputError& e) {
    if (std::string(e.what()).find('\n') != std::string::npos) __builtin_trap();
  }
}

}  // namespace fathom::fuzz
