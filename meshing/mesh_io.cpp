// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/mesh_io.hpp"

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <string>
#include <string_view>
#include <vector>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "core/files.hpp"
#include "meshing/detail/mesh_readers.hpp"

namespace maquette::meshing {
namespace {

static_assert(std::endian::native == std::endian::little, "PLY and STL are written as in memory");
static_assert(sizeof(Vec3) == 3 * sizeof(double));

constexpr std::size_t kBufferBytes = std::size_t{1} << 20;
constexpr std::size_t kFaceBytes = 1 + 3 * sizeof(std::uint32_t);

/// A whole file, read-only, paged in by the system as it is read.
class MappedFile {
 public:
  static Result<MappedFile> open(const std::filesystem::path& path) {
    const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    if (fd < 0) {
      if (errno == ENOENT)
        return fail(kFileNotFound, fmt::format("{}: no such file", path.string()));
      return fail(kFileNotReadable,
                  fmt::format("{}: cannot read ({})", path.string(), std::strerror(errno)));
    }
    MappedFile file;
    struct stat status {};
    if (::fstat(fd, &status) != 0 || !S_ISREG(status.st_mode)) {
      ::close(fd);
      return fail(kFileNotReadable, fmt::format("{}: is no regular file", path.string()));
    }
    file.size_ = static_cast<std::size_t>(status.st_size);
    if (file.size_ > 0) {
      file.data_ = ::mmap(nullptr, file.size_, PROT_READ, MAP_PRIVATE, fd, 0);
      if (file.data_ == MAP_FAILED) {
        const int reason = errno;
        file.data_ = nullptr;
        ::close(fd);
        return fail(kFileNotReadable,
                    fmt::format("{}: cannot read ({})", path.string(), std::strerror(reason)));
      }
      ::madvise(file.data_, file.size_, MADV_SEQUENTIAL);
    }
    ::close(fd);
    return file;
  }
  MappedFile(MappedFile&& other) noexcept
      : data_(std::exchange(other.data_, nullptr)), size_(other.size_) {}
  MappedFile& operator=(MappedFile&&) = delete;
  ~MappedFile() {
    if (data_ != nullptr) ::munmap(data_, size_);
  }
  [[nodiscard]] std::string_view bytes() const { return {static_cast<const char*>(data_), size_}; }

 private:
  MappedFile() = default;
  void* data_ = nullptr;
  std::size_t size_ = 0;
};

bool starts_with_word(std::string_view text, std::string_view word) {
  if (text.size() < word.size()) return false;
  for (std::size_t i = 0; i < word.size(); ++i)
    if ((text[i] | 0x20) != word[i]) return false;
  return text.size() == word.size() ||
         std::string_view(" \t\r\n").find(text[word.size()]) != std::string_view::npos;
}

bool has_nul(std::string_view text) {
  return text.substr(0, 1024).find('\0') != std::string_view::npos;
}

Result<PaintedMesh> read_by_content(std::string_view bytes, const std::filesystem::path& folder,
                                    bool looks, const RunContext& run) {
  const auto bare = [](Result<TriMesh> mesh) -> Result<PaintedMesh> {
    if (!mesh) return tl::unexpected(std::move(mesh).error());
    PaintedMesh whole;
    whole.mesh = std::move(*mesh);
    return whole;
  };
  if (detail::looks_like_gltf(bytes)) return detail::read_gltf(bytes, folder, looks, run);
  if (starts_with_word(bytes, "ply")) return bare(detail::read_ply(bytes, run));
  // Some binary STL files begin with "solid"; the length of the file tells.
  if (bytes.size() >= 84) {
    std::uint32_t triangles = 0;
    std::memcpy(&triangles, bytes.data() + 80, sizeof triangles);
    if (bytes.size() == 84 + 50 * std::size_t{triangles})
      return bare(detail::read_binary_stl(bytes, run));
  }
  const auto first = std::min(bytes.find_first_not_of(" \t\r\n"), bytes.size());
  if (!has_nul(bytes)) {
    if (starts_with_word(bytes.substr(first), "solid"))
      return bare(detail::read_ascii_stl(bytes, run));
    if (first < bytes.size()) return detail::read_obj(bytes, folder, looks, run);
  } else if (bytes.size() >= 84) {
    return bare(detail::read_binary_stl(bytes, run));  // truncated: says by how much
  }
  return fail(kMeshFormat, "neither PLY, STL, OBJ nor glTF");
}

Result<PaintedMesh> read_file_of(const std::filesystem::path& path, bool looks,
                                 const RunContext& run) {
  MAQUETTE_TRY(const auto file, MappedFile::open(path));
  auto read = read_by_content(file.bytes(), path.parent_path(), looks, run);
  if (read && read->mesh.triangles.empty())
    read = fail(kMeshEmpty, "contains no triangle; a surface mesh is expected");
  const auto nothing = [](const Paint& p) { return !p.described && p.name.empty(); };
  if (read && looks && std::all_of(read->paints.begin(), read->paints.end(), nothing))
    read = fail(kNoPaint,
                "has no materials of its own; name one of the scene's, or give an OBJ with its "
                ".mtl or a glTF");
  if (!read) return tl::unexpected(std::move(read).error().within(path.string()));
  return read;
}

}  // namespace

Result<void> write_ply(const TriMesh& mesh, const std::filesystem::path& path,
                       const RunContext& run) {
  return write_ply(TriMeshStream(mesh), path, run);
}

Result<void> write_ply(const MeshStream& mesh, const std::filesystem::path& path,
                       const RunContext& run) {
  const std::uint64_t vertices = mesh.vertex_count(), faces = mesh.triangle_count();
  MAQUETTE_TRY(auto file, AtomicFile::create(path));
  file.write(
      fmt::format("ply\nformat binary_little_endian 1.0\n"
                  "comment frame: model, right-handed, x east, y north, z up\ncomment unit: mm\n"
                  "element vertex {}\nproperty double x\nproperty double y\nproperty double z\n"
                  "element face {}\nproperty list uchar uint vertex_indices\nend_header\n",
                  vertices, faces));
  const double all_bytes = static_cast<double>(vertices * sizeof(Vec3) + faces * kFaceBytes);
  std::size_t written = 0;
  const auto write = [&](const void* data, std::size_t bytes) {
    file.write(data, bytes);
    written += bytes;
    run.progress(static_cast<double>(written) / all_bytes);
  };
  const auto stopped = [&] { return fail(kCancelled, "stopped while writing " + path.string()); };

  std::vector<Vec3> points(kBufferBytes / sizeof(Vec3));
  for (std::uint64_t i = 0; i < vertices; i += points.size()) {
    if (run.stopped()) return stopped();
    const std::size_t count = std::min<std::uint64_t>(points.size(), vertices - i);
    mesh.vertices(i, std::span(points.data(), count));
    write(points.data(), sizeof(Vec3) * count);
  }
  std::vector<MeshStream::Triangle> triangles(kBufferBytes / kFaceBytes);
  std::vector<char> buffer(triangles.size() * kFaceBytes);
  for (std::uint64_t i = 0; i < faces; i += triangles.size()) {
    if (run.stopped()) return stopped();
    const std::size_t count = std::min<std::uint64_t>(triangles.size(), faces - i);
    mesh.triangles(i, std::span(triangles.data(), count));
    char* out = buffer.data();
    for (std::size_t f = 0; f < count; ++f, out += kFaceBytes) {
      *out = 3;
      std::memcpy(out + 1, triangles[f].data(), kFaceBytes - 1);
    }
    write(buffer.data(), static_cast<std::size_t>(out - buffer.data()));
  }
  return file.commit();
}

Result<TriMesh> read_mesh(const std::filesystem::path& path, const RunContext& run) {
  MAQUETTE_TRY(auto read, read_file_of(path, false, run));
  return std::move(read.mesh);
}

Result<PaintedMesh> read_painted_mesh(const std::filesystem::path& path, const RunContext& run) {
  return read_file_of(path, true, run);
}

Result<bool> is_gltf(const std::filesystem::path& path) {
  MAQUETTE_TRY(const auto file, MappedFile::open(path));
  return detail::looks_like_gltf(file.bytes());
}

}  // namespace maquette::meshing
