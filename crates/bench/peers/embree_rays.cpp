// Casts rays through a mesh by Embree 4 and times them: EMBREE_LIBRARY FOLDER NAME KIND...
//
// FOLDER holds NAME.ply (positions, triangles; little-endian) and rays_NAME_KIND.bin (8 f32 each: origin, direction,
// smallest and largest distance). Writes hits_NAME_KIND.bin (f32 distance, i32 triangle, -1 for a miss; medium quality)
// and prints, for each mode, milliseconds to build, and for each kind million rays a second of CPU time on one thread:
// single closest hits, single occlusion, closest hits in packets of 16. Functions of the library are looked up by
// name, for its headers need not be installed; the structures are those of embree4/rtcore_ray.h.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <dlfcn.h>
#include <fstream>
#include <functional>
#include <sstream>
#include <string>
#include <time.h>
#include <vector>

struct alignas(16) Ray {
    float origin[3], near, direction[3], time, far;
    unsigned mask, id, flags;
    float normal[3], u, v;
    unsigned primitive, geometry, instance[4];
};

struct alignas(64) Packet {
    float origin[3][16], near[16], direction[3][16], time[16], far[16];
    unsigned mask[16], id[16], flags[16];
    float normal[3][16], u[16], v[16];
    unsigned primitive[16], geometry[16], instance[2][16];
    // The library may know more of a hit than this.
    char more[512];
};

// flags 1 << 16: coherent rays.
struct Arguments {
    int flags;
    unsigned features;
    void *context, *filter, *function;
};

struct Mode {
    const char *name;
    int quality, flags;
};

// RTC_BUILD_QUALITY_MEDIUM and _HIGH; RTC_SCENE_FLAG_ROBUST.
const Mode MODES[] = {{"medium", 1, 0}, {"high", 2, 0}, {"robust", 1, 1 << 2}};
const int REPETITIONS = 7;

void *library;

template <class Function> Function *symbol(const char *name) {
    void *found = dlsym(library, name);
    if (!found) {
        fprintf(stderr, "%s\n", dlerror());
        exit(1);
    }
    return reinterpret_cast<Function *>(found);
}

double cpu_seconds() {
    timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return t.tv_sec + t.tv_nsec * 1e-9;
}

double median_seconds(const std::function<void()> &work) {
    std::vector<double> times;
    work();
    for (int k = 0; k < REPETITIONS; k++) {
        double start = cpu_seconds();
        work();
        times.push_back(cpu_seconds() - start);
    }
    std::sort(times.begin(), times.end());
    return times[REPETITIONS / 2];
}

std::vector<float> floats(const std::string &path) {
    std::ifstream file(path, std::ios::binary | std::ios::ate);
    if (!file) {
        fprintf(stderr, "%s: cannot be read\n", path.c_str());
        exit(1);
    }
    std::vector<float> out(size_t(file.tellg()) / 4);
    file.seekg(0).read(reinterpret_cast<char *>(out.data()), out.size() * 4);
    return out;
}

struct Mesh {
    std::vector<float> positions;
    std::vector<unsigned> triangles;

    explicit Mesh(const std::string &path) {
        std::ifstream file(path, std::ios::binary);
        std::string line;
        while (std::getline(file, line) && line != "end_header") {
            std::istringstream words(line);
            std::string first, second;
            size_t count;
            words >> first >> second >> count;
            if (first == "element" && second == "vertex") positions.resize(3 * count);
            if (first == "element" && second == "face") triangles.resize(3 * count);
        }
        file.read(reinterpret_cast<char *>(positions.data()), positions.size() * 4);
        for (size_t i = 0; i < triangles.size(); i += 3) {
            file.get();
            file.read(reinterpret_cast<char *>(&triangles[i]), 12);
        }
    }
};

Ray single(const float *ray) {
    Ray out{};
    memcpy(out.origin, ray, 12);
    memcpy(out.direction, ray + 3, 12);
    out.near = ray[6], out.far = ray[7];
    out.mask = out.geometry = out.primitive = out.instance[0] = ~0u;
    return out;
}

void fill(Packet &packet, const float *rays) {
    for (int j = 0; j < 16; j++) {
        const float *ray = rays + 8 * j;
        for (int k = 0; k < 3; k++) packet.origin[k][j] = ray[k], packet.direction[k][j] = ray[3 + k];
        packet.near[j] = ray[6], packet.far[j] = ray[7];
        packet.time[j] = 0, packet.flags[j] = 0;
        packet.mask[j] = packet.geometry[j] = packet.instance[0][j] = ~0u;
    }
}

void cast(const std::string &folder, const std::string &name, const std::string &kind, void *scene, const Mode &mode) {
    auto intersect = symbol<void(void *, Ray *, Arguments *)>("rtcIntersect1");
    auto occluded = symbol<void(void *, Ray *, Arguments *)>("rtcOccluded1");
    auto intersect16 = symbol<void(const int *, void *, Packet *, Arguments *)>("rtcIntersect16");
    std::vector<float> rays = floats(folder + "/rays_" + name + "_" + kind + ".bin");
    size_t count = rays.size() / 8;
    std::vector<float> hits(2 * count);
    Arguments plain{0, ~0u, nullptr, nullptr, nullptr}, coherent = plain;
    coherent.flags = kind == "camera" ? 1 << 16 : 0;
    double closest = median_seconds([&] {
        for (size_t i = 0; i < count; i++) {
            Ray ray = single(&rays[8 * i]);
            intersect(scene, &ray, &plain);
            bool hit = ray.geometry != ~0u;
            int triangle = hit ? int(ray.primitive) : -1;
            hits[2 * i] = hit ? ray.far : -1;
            memcpy(&hits[2 * i + 1], &triangle, 4);
        }
    });
    double occlusion = median_seconds([&] {
        for (size_t i = 0; i < count; i++) {
            Ray ray = single(&rays[8 * i]);
            occluded(scene, &ray, &plain);
        }
    });
    int valid[16];
    std::fill(valid, valid + 16, -1);
    double packets = median_seconds([&] {
        Packet packet;
        for (size_t i = 0; i + 16 <= count; i += 16) {
            fill(packet, &rays[8 * i]);
            intersect16(valid, scene, &packet, &coherent);
        }
    });
    auto rate = [&](double seconds) { return count / seconds / 1e6; };
    printf("cast %s %s %g %g %g\n", mode.name, kind.c_str(), rate(closest), rate(occlusion), rate(packets));
    if (mode.quality == 1 && mode.flags == 0) {
        std::ofstream out(folder + "/hits_" + name + "_" + kind + ".bin", std::ios::binary);
        out.write(reinterpret_cast<char *>(hits.data()), hits.size() * 4);
    }
}

int main(int count, char **arguments) {
    if (count < 5 || !(library = dlopen(arguments[1], RTLD_NOW))) {
        fprintf(stderr, "%s\n", count < 5 ? "EMBREE_LIBRARY FOLDER NAME KIND..." : dlerror());
        return 1;
    }
    std::string folder = arguments[2], name = arguments[3];
    Mesh mesh(folder + "/" + name + ".ply");
    void *device = symbol<void *(const char *)>("rtcNewDevice")("threads=1");
    auto buffer = symbol<void *(void *, int, unsigned, int, size_t, size_t)>("rtcSetNewGeometryBuffer");
    for (const Mode &mode : MODES) {
        void *scene = symbol<void *(void *)>("rtcNewScene")(device);
        symbol<void(void *, int)>("rtcSetSceneBuildQuality")(scene, mode.quality);
        symbol<void(void *, int)>("rtcSetSceneFlags")(scene, mode.flags);
        // RTC_GEOMETRY_TYPE_TRIANGLE; RTC_BUFFER_TYPE_VERTEX of RTC_FORMAT_FLOAT3, _INDEX of _UINT3.
        void *geometry = symbol<void *(void *, int)>("rtcNewGeometry")(device, 0);
        size_t vertices = mesh.positions.size() / 3, triangles = mesh.triangles.size() / 3;
        memcpy(buffer(geometry, 1, 0, 0x9003, 12, vertices), mesh.positions.data(), 12 * vertices);
        memcpy(buffer(geometry, 0, 0, 0x5003, 12, triangles), mesh.triangles.data(), 12 * triangles);
        double start = cpu_seconds();
        symbol<void(void *)>("rtcCommitGeometry")(geometry);
        symbol<unsigned(void *, void *)>("rtcAttachGeometry")(scene, geometry);
        symbol<void(void *)>("rtcCommitScene")(scene);
        printf("build %s %g\n", mode.name, 1e3 * (cpu_seconds() - start));
        for (int k = 4; k < count; k++) cast(folder, name, arguments[k], scene, mode);
        symbol<void(void *)>("rtcReleaseGeometry")(geometry);
        symbol<void(void *)>("rtcReleaseScene")(scene);
    }
}
