#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "recon/topside/work/digest.hpp"

namespace fathom::topside {

// A result of the pipeline on disk: named blocks of bytes behind one another, then an index of names, places
// and digests, then the index's own place and digest. Every byte is under a digest, so that damage is noticed
// by whoever reads it.
struct BlockPlace {
  std::uint64_t offset = 0, size = 0;
  Digest digest;
};

// Writes such a file under a temporary name of its own; commit() renames it. Throws std::runtime_error when
// the disk refuses.
class WorkFileWriter {
 public:
  WorkFileWriter(std::filesystem::path path, const Digest& key);
  ~WorkFileWriter();
  WorkFileWriter(const WorkFileWriter&) = delete;
  WorkFileWriter& operator=(const WorkFileWriter&) = delete;

  void add(const std::string& name, std::span<const std::uint8_t> bytes);  // each name once
  void commit();

 private:
  std::filesystem::path path_, temporary_;
  Digest key_;
  std::ofstream stream_;
  std::map<std::string, BlockPlace> index_;
  std::uint64_t at_ = 0;
  bool committed_ = false;
};

// One that is there. Its blocks are read, and checked, one at a time.
class WorkFile {
 public:
  // None when there is no such file, or it is damaged, or of another key.
  [[nodiscard]] static std::optional<WorkFile> open(const std::filesystem::path& path, const Digest& key);

  // The block's bytes; throws DamagedWork when it is not there or not what was written.
  [[nodiscard]] Bytes read(const std::string& name) const;
  [[nodiscard]] bool holds(const std::string& name) const { return index_.contains(name); }
  [[nodiscard]] const std::map<std::string, BlockPlace>& index() const { return index_; }
  [[nodiscard]] const Digest& digestOf(const std::string& name) const;  // throws DamagedWork
  [[nodiscard]] const Digest& content() const { return content_; }      // of all blocks, names included
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  [[nodiscard]] bool whole() const;  // reads everything

 private:
  std::filesystem::path path_;
  std::map<std::string, BlockPlace> index_;
  Digest content_;
};

// A work file that was found damaged while it was in use.
class DamagedWork : public std::runtime_error {
 public:
  explicit DamagedWork(std::filesystem::path path)
      : std::runtime_error(path.string() + ": damaged"), path_(std::move(path)) {}
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace fathom::topside
