#pragma once

#include <atomic>
#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "recon/topside/work/work_file.hpp"

namespace fathom::topside {

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
