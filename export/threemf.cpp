// SPDX-License-Identifier: GPL-3.0-or-later
#include <Model/COM/NMR_DLLInterfaces.h>

#include "core/files.hpp"
#include "export/cad.hpp"
#include "export/limits.hpp"
#include "export/zip_times.hpp"

namespace maquette::exporting {
namespace {

constexpr DWORD kOk = 0;
constexpr float kMaxCoordinate = 1e9F;  ///< lib3mf's own

/// Handles of lib3mf are counted references behind void*.
class Handle {
 public:
  Handle() = default;
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;
  ~Handle() {
    if (instance_ != nullptr) NMR::lib3mf_release(static_cast<NMR::PLib3MFBase*>(instance_));
  }
  template <class T>
  [[nodiscard]] T** out() {
    return reinterpret_cast<T**>(&instance_);
  }
  [[nodiscard]] NMR::PLib3MFBase* get() const { return static_cast<NMR::PLib3MFBase*>(instance_); }

 private:
  void* instance_ = nullptr;
};

/// First failure wins; later calls are not made.
class Steps {
 public:
  explicit Steps(const std::filesystem::path& path) : path_(path) {}
  template <class Call>
  void operator()(const char* what, const Handle& on, Call call) {
    if (!error_.empty()) return;
    const auto result = static_cast<DWORD>(call());
    if (result == kOk) return;
    DWORD code = 0;
    LPCSTR text = nullptr;
    if (on.get() != nullptr) NMR::lib3mf_getlasterror(on.get(), &code, &text);
    error_ = fmt::format("{}: lib3mf could not {}: {} (code {:#x}); check the mesh with verify",
                         path_.string(), what, text != nullptr && *text != 0 ? text : "no reason",
                         code != 0 ? code : result);
  }
  [[nodiscard]] const std::string& error() const { return error_; }

 private:
  const std::filesystem::path& path_;
  std::string error_;
};

/// The writer draws random UUIDs unless it is given some; these follow from the
/// object's place, so that the same model gives the same file.
std::string fixed_uuid(int kind, std::size_t number) {
  return fmt::format("6d617175-6574-4{:03x}-8000-{:012x}", kind, number);
}

std::vector<NMR::MODELMESHVERTEX> corners(const TriMesh& mesh) {
  std::vector<NMR::MODELMESHVERTEX> result(mesh.vertices_mm.size());
  for (std::size_t i = 0; i < result.size(); ++i) {
    const Vec3 v = mesh.vertices_mm[i];
    result[i].m_fPosition[0] = static_cast<float>(v.x);
    result[i].m_fPosition[1] = static_cast<float>(v.y);
    result[i].m_fPosition[2] = static_cast<float>(v.z);
  }
  return result;
}

std::vector<NMR::MODELMESHTRIANGLE> faces(const TriMesh& mesh) {
  std::vector<NMR::MODELMESHTRIANGLE> result(mesh.triangles.size());
  for (std::size_t i = 0; i < result.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k) result[i].m_nIndices[k] = mesh.triangles[i][k];
  return result;
}

void add_object(Steps& step, const Handle& model, Handle& object, const NamedMesh& part,
                std::size_t number) {
  step("add an object", model, [&] {
    return NMR::lib3mf_model_addmeshobject(model.get(), object.out<NMR::PLib3MFModelMeshObject>());
  });
  step("take the geometry", object, [&] {
    auto vertices = corners(*part.mesh);
    auto triangles = faces(*part.mesh);
    return NMR::lib3mf_meshobject_setgeometry(object.get(), vertices.data(),
                                              static_cast<DWORD>(vertices.size()), triangles.data(),
                                              static_cast<DWORD>(triangles.size()));
  });
  step("name an object", object,
       [&] { return NMR::lib3mf_object_setnameutf8(object.get(), part.name.c_str()); });
  step("number an object", object, [&] {
    return NMR::lib3mf_object_setpartnumberutf8(object.get(), part.part_number.c_str());
  });
  step("set an object's UUID", object,
       [&] { return NMR::lib3mf_object_setuuidutf8(object.get(), fixed_uuid(1, number).c_str()); });
}

void add_item(Steps& step, const Handle& model, const Handle& object, const BuildItem& part,
              std::size_t number) {
  Handle item;
  NMR::MODELTRANSFORM place{};
  for (std::size_t k = 0; k < 3; ++k) place.m_fFields[k][k] = 1.0F;
  place.m_fFields[0][3] = static_cast<float>(part.shift_mm.x);
  place.m_fFields[1][3] = static_cast<float>(part.shift_mm.y);
  place.m_fFields[2][3] = static_cast<float>(part.shift_mm.z);
  step("build an object", model, [&] {
    return NMR::lib3mf_model_addbuilditem(model.get(), object.get(),
                                          part.shift_mm == Vec3{} ? nullptr : &place,
                                          item.out<NMR::PLib3MFModelBuildItem>());
  });
  step("number a part", item, [&] {
    return NMR::lib3mf_builditem_setpartnumberutf8(item.get(), part.part_number.c_str());
  });
  step("set a part's UUID", item, [&] {
    return NMR::lib3mf_builditem_setuuidutf8(item.get(), fixed_uuid(2, number).c_str());
  });
}

/// What lib3mf would take silently or answer with a number.
Result<void> check_parts(const std::vector<NamedMesh>& meshes, const std::vector<BuildItem>& items,
                         const std::filesystem::path& path) {
  if (meshes.empty() || items.empty())
    return fail(kEmptyMesh, fmt::format("{}: no mesh to be written", path.string()));
  std::uint64_t triangles = 0;
  for (const NamedMesh& part : meshes) {
    if (part.mesh == nullptr)
      return fail(kEmptyMesh, fmt::format("{}: part '{}' has no mesh", path.string(), part.name));
    triangles += part.mesh->triangles.size();
  }
  MAQUETTE_TRY_VOID(within_limit(triangles, k3mfTriangleLimit, "triangles", "3MF", path));
  for (const BuildItem& item : items)
    MAQUETTE_CHECK(item.mesh < meshes.size(), "mesh {} of {}", item.mesh, meshes.size());
  for (const NamedMesh& part : meshes) {
    MAQUETTE_TRY_VOID(check_mesh_for_export(*part.mesh, path));
    const Box3 box = part.mesh->bounds();
    for (const double x : {box.min.x, box.min.y, box.min.z, box.max.x, box.max.y, box.max.z})
      if (!(std::abs(x) < static_cast<double>(kMaxCoordinate)))
        return fail(kLibraryFailed, fmt::format("{}: part '{}': coordinate {} mm is beyond what "
                                                "lib3mf takes; shift the model to its origin",
                                                path.string(), part.name, x));
  }
  return {};
}

}  // namespace

Result<void> write_3mf(const std::vector<NamedMesh>& meshes, const std::filesystem::path& path,
                       const RunContext& run) {
  std::vector<BuildItem> items;
  for (const NamedMesh& part : meshes) items.push_back({items.size(), Vec3{}, part.part_number});
  return write_3mf(meshes, items, path, run);
}

Result<void> write_3mf(const std::vector<NamedMesh>& meshes, const std::vector<BuildItem>& items,
                       const std::filesystem::path& path, const RunContext& run) {
  MAQUETTE_TRY_VOID(check_parts(meshes, items, path));
  AtomicPath partial(path);
  MAQUETTE_TRY_VOID(partial.prepare());
  Steps step(path);
  Handle model, writer;
  const auto cancelled = [&] {
    return fail(kCancelled, fmt::format("{}: stopped while it was written", path.string()));
  };
  step("start a model", model,
       [&] { return NMR::lib3mf_createmodel(model.out<NMR::PLib3MFModel>()); });
  step("set the unit", model, [&] {
    return NMR::lib3mf_model_setunit(model.get(), static_cast<DWORD>(NMR::MODELUNIT_MILLIMETER));
  });
  step("set the build's UUID", model,
       [&] { return NMR::lib3mf_model_setbuilduuidutf8(model.get(), fixed_uuid(0, 0).c_str()); });
  step("add metadata", model,
       [&] { return NMR::lib3mf_model_addmetadatautf8(model.get(), "Application", "maquette"); });
  step("add metadata", model, [&] {
    return NMR::lib3mf_model_addmetadatautf8(model.get(), "Description",
                                             "model frame: x east, y north, z up, millimetres");
  });
  std::vector<Handle> objects(meshes.size());
  for (std::size_t i = 0; i < meshes.size(); ++i) {
    if (run.stopped()) return cancelled();
    add_object(step, model, objects[i], meshes[i], i + 1);
    run.progress(0.2 * static_cast<double>(i + 1) / static_cast<double>(meshes.size()));
  }
  for (std::size_t i = 0; i < items.size(); ++i)
    add_item(step, model, objects[items[i].mesh], items[i], i + 1);
  step("start the writer", model, [&] {
    return NMR::lib3mf_model_querywriter(model.get(), "3mf", writer.out<NMR::PLib3MFModelWriter>());
  });
  const auto monitor = [](int percent, NMR::ProgressIdentifier, void* user) {
    const auto& context = *static_cast<const RunContext*>(user);
    if (percent >= 0) context.progress(0.2 + 0.008 * std::min(percent, 100));
    return !context.stopped();
  };
  step("watch the writer", writer, [&] {
    return NMR::lib3mf_writer_setprogresscallback(writer.get(), monitor,
                                                  const_cast<RunContext*>(&run));
  });
  step("write the file", writer,
       [&] { return NMR::lib3mf_writer_writetofileutf8(writer.get(), partial.path().c_str()); });
  if (run.stopped()) return cancelled();
  if (!step.error().empty()) return fail(kLibraryFailed, step.error());
  MAQUETTE_TRY_VOID(set_zip_times(partial.path()));
  run.progress(1.0);
  return partial.commit();
}

}  // namespace maquette::exporting
