#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <mutex>
#include <optional>
#include <set>
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

// What a result has cost: kept beside it, not in it, as it is not the same twice.
using Costs = std::map<std::string, double>;

// The results of a mission's stages in a work folder: <folder>/<stage>/<item>-<key>.work, where the key is a
// digest of all that the result depends on, so that a result of that name is the result. One file an item:
// a new one takes the place of those of other keys. Several processes, on several machines, may work on
// different items of one folder at once.
class StageStore {
 public:
  enum class Access {
    kAlone,   // no other process may work here: leftovers of killed ones are swept away
    kShared,  // others may, on other items
  };
  // Throws InputError when the folder cannot be made, is not a work folder, or is in use otherwise.
  StageStore(std::filesystem::path folder, Access access);
  ~StageStore();
  StageStore(const StageStore&) = delete;
  StageStore& operator=(const StageStore&) = delete;

  // The result, whole, or none. The first time it is asked for, all its bytes are checked; a damaged file is
  // said on stderr and removed.
  [[nodiscard]] std::optional<WorkFile> find(const std::string& stage, const std::string& item,
                                             const Digest& key);
  // The same without a look at the blocks, which are checked when they are read.
  [[nodiscard]] std::optional<WorkFile> open(const std::string& stage, const std::string& item,
                                             const Digest& key) const;
  // As open(), of a result that must be there: throws DamagedWork.
  [[nodiscard]] WorkFile get(const std::string& stage, const std::string& item, const Digest& key) const;
  // Where a result is to be written; and what follows once it is.
  [[nodiscard]] WorkFileWriter writer(const std::string& stage, const std::string& item, const Digest& key);
  void written(const std::string& stage, const std::string& item, const Digest& key, const Costs& costs);
  // Removes the results of a stage's other items.
  void keepOnly(const std::string& stage, const std::set<std::string>& items);
  // Of the newest result of every item of a stage, by item.
  [[nodiscard]] std::map<std::string, Costs> costs(const std::string& stage) const;

  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }
  [[nodiscard]] std::size_t damaged() const { return damaged_; }

 private:
  [[nodiscard]] std::filesystem::path pathOf(const std::string& stage, const std::string& item,
                                             const Digest& key) const;

  std::filesystem::path folder_;
  int lock_ = -1;
  mutable std::mutex mutex_;
  std::set<std::filesystem::path> checked_;  // found whole, or written, by this process
  std::atomic<std::size_t> damaged_ = 0;
};

}  // namespace fathom::topside
