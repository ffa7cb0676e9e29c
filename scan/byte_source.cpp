// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/byte_source.hpp"

#include <cerrno>
#include <cstring>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include "core/files.hpp"
#include "scan/cloud.hpp"

namespace maquette::scan::detail {
namespace {
constexpr std::size_t kWindow = std::size_t{1} << 20;
}

Result<ByteSource> ByteSource::open(const std::filesystem::path& path) {
  ByteSource source;
  source.name_ = path.string();
  source.file_ = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (source.file_ < 0)
    return fail(errno == ENOENT || errno == ENOTDIR ? kFileNotFound : kFileNotReadable,
                fmt::format("{}: cannot read ({})", source.name_, std::strerror(errno)));
  struct stat status {};
  if (::fstat(source.file_, &status) != 0 || !S_ISREG(status.st_mode))
    return fail(kFileNotReadable, fmt::format("{}: is no regular file; a folder or a pipe cannot "
                                              "be read as a point cloud",
                                              source.name_));
  source.size_ = static_cast<std::uint64_t>(status.st_size);
  return source;
}

ByteSource::ByteSource(std::string_view bytes, std::string name)
    : name_(std::move(name)), size_(bytes.size()), window_(bytes.data()), end_(bytes.size()) {}

ByteSource::ByteSource(ByteSource&& other) noexcept {
  *this = std::move(other);
}

ByteSource& ByteSource::operator=(ByteSource&& other) noexcept {
  std::swap(name_, other.name_);
  std::swap(size_, other.size_);
  std::swap(file_, other.file_);
  std::swap(own_, other.own_);
  std::swap(capacity_, other.capacity_);
  std::swap(window_, other.window_);
  std::swap(window_start_, other.window_start_);
  std::swap(at_, other.at_);
  std::swap(end_, other.end_);
  std::swap(line_number_, other.line_number_);
  std::swap(error_, other.error_);
  return *this;
}

ByteSource::~ByteSource() {
  if (file_ >= 0) ::close(file_);
}

void ByteSource::fill(std::size_t n) {
  if (file_ < 0 || error_ != 0) return;  // memory is all there
  const std::size_t left = end_ - at_;
  const std::size_t wanted = std::max(n, kWindow);
  if (capacity_ < wanted) {
    std::unique_ptr<char[]> larger(new char[wanted]);
    if (left > 0) std::memcpy(larger.get(), window_ + at_, left);
    own_ = std::move(larger);
    capacity_ = wanted;
  } else if (left > 0) {
    std::memmove(own_.get(), window_ + at_, left);
  }
  window_ = own_.get();
  window_start_ += at_;
  at_ = 0;
  end_ = left;
  while (end_ < n && window_start_ + end_ < size_) {
    const ::ssize_t got = ::pread(file_, own_.get() + end_, capacity_ - end_,
                                  static_cast<off_t>(window_start_ + end_));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) {
      error_ = got < 0 ? errno : EIO;  // shrunk while it was read
      return;
    }
    end_ = std::min(end_ + static_cast<std::size_t>(got),
                    static_cast<std::size_t>(size_ - window_start_));  // grown: not ours
  }
}

void ByteSource::seek(std::uint64_t position) {
  position = std::min(position, size_);
  if (position >= window_start_ && position - window_start_ <= end_) {
    at_ = static_cast<std::size_t>(position - window_start_);
    return;
  }
  window_start_ = position;
  at_ = end_ = 0;
}

std::optional<std::string_view> ByteSource::line() {
  std::size_t searched = 0;
  std::string_view view = peek(1);
  if (view.empty()) return std::nullopt;
  ++line_number_;
  for (std::size_t want = 4096;; want *= 4) {
    view = peek(std::min(want, kLongestLine));
    const void* found = std::memchr(view.data() + searched, '\n', view.size() - searched);
    if (found != nullptr) {
      const auto length = static_cast<std::size_t>(static_cast<const char*>(found) - view.data());
      skip(length + 1);
      view = view.substr(0, length);
      break;
    }
    if (view.size() < want) {  // end of file, or as long as a line may be
      skip(view.size());
      break;
    }
    searched = view.size();
  }
  if (view.ends_with('\r')) view.remove_suffix(1);
  return view;
}

tl::unexpected<Error> ByteSource::ended(std::string_view where) const {
  if (error_ != 0)
    return fail(kFileNotReadable, fmt::format("{}: reading failed at byte {} ({})", name_,
                                              window_start_ + end_, std::strerror(error_)));
  return fail(kCloudFormat, fmt::format("{}: byte {}: the file ends {}", name_, size_, where));
}

}  // namespace maquette::scan::detail
