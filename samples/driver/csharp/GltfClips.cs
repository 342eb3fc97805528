// The clips of a .glb, for flesh: straight lines between a clip's keys kick it, and a bake lets it follow a smooth curve.

using System;
using System.Collections.Generic;
using System.Linq;

namespace Wrinkles
{
    using Json = Dictionary<string, object>;

    /// <summary>How a clip takes a place through a frame, from 0 at its beginning to 1 at its end, the way from the place that
    /// is shown to the curve, and how far a walk is put back where its clip begins anew.</summary>
    public sealed class Known
    {
        public Func<double, double[]> Path;
        public double[] Beside, Back;
    }

    public sealed class GltfClips
    {
        /// <summary>Seconds of a clip in a second beyond which it has been put to another time.</summary>
        const double Fastest = 4;
        /// <summary>Keys by which a loop goes on at both ends: slopes depend on no others.</summary>
        const int Around = 2;
        /// <summary>Pieces of a clip of few keys, and samples a second of one that is smooth between its keys, as a bake has.</summary>
        const int Pieces = 4, Samples = 60;
        /// <summary>Part of a clip below which two keys are a jump of the pose, which no curve follows.</summary>
        const double Apart = 3e-5;
        /// <summary>Difference of a quaternion or scale below which a clip ends in the pose of its beginning.</summary>
        const double Same = 1e-3;
        /// <summary>A loop's change of velocity, over that at the keys beside its ends, or over all change in it, at most.</summary>
        const double Beside = 2, Overall = 0.1;
        static readonly double[] None = { 0, 0, 0 };
        readonly Json gltf;
        readonly byte[] file;
        readonly int data;
        readonly List<Json> nodes;
        readonly Dictionary<int, int> parents = new Dictionary<int, int>();
        readonly Dictionary<string, Curve> made = new Dictionary<string, Curve>();

        /// <param name="file">A .glb that holds its own buffer; of another file no clip is known.</param>
        public GltfClips(byte[] file)
        {
            this.file = file;
            gltf = GltfExtras.Document(file, out data);
            nodes = Read.List(gltf, "nodes").Cast<Json>().ToList();
            for (var index = 0; index < nodes.Count; index++)
                foreach (var child in Read.List(nodes[index], "children")) parents[(int)Read.Number(child)] = index;
        }

        sealed class Track
        {
            public string Path;
            public double[] Times;
            // By key: a value, or of CUBICSPLINE the tangent in, the value and the tangent out.
            public double[][][] Keys;
            public bool Smooth, Stepped;
            public double[] Value(int key) => Keys[key][Smooth ? 1 : 0];
        }

        sealed class Curve
        {
            public Func<double, double[]> At, Shown;
            public double Seconds;
            public double[] Whole;
        }

        /// <summary>What is known of a joint's place; null if the clip is not in the file, or leaves the joint.</summary>
        /// <param name="before">Seconds of the clip at the last frame; not a number after another clip.</param>
        /// <param name="root">The matrix to world space of what the file's scene stands below.</param>
        public Known During(string joint, double[] at, string clip, double time, double before, double elapsed, double[] root)
        {
            var key = clip + "\n" + joint + "\n" + string.Join(" ", at);
            if (!made.TryGetValue(key, out var curve)) made[key] = curve = CurveOf(clip, joint, at);
            if (curve == null) return null;
            Func<double[], double[]> turned = v => V.Minus(V.Moved(root, v), V.Moved(root, None));
            var anew = time < before && curve.Seconds > 0;
            var ran = time - before + (anew ? curve.Seconds : 0);
            var runs = ran >= 0 && ran <= Fastest * elapsed;
            return new Known
            {
                Path = part => turned(curve.At(time - (runs ? (1 - part) * ran : 0))),
                Beside = turned(V.Minus(curve.At(time), curve.Shown(time))),
                Back = turned(anew && runs ? V.Minus(None, curve.Whole) : None),
            };
        }

        /// <summary>The same while clips blend: by clip seconds, those at the last frame, and a share; shares add up to 1.</summary>
        public Known Blended(string joint, double[] at, IEnumerable<(string clip, double time, double before, double share)> playing, double elapsed, double[] root)
        {
            var found = playing.Select(each => (share: each.share, known: During(joint, at, each.clip, each.time, each.before, elapsed, root))).Where(each => each.known != null).ToArray();
            Func<Func<Known, double[]>, double[]> mean = placeOf => new[] { 0, 1, 2 }.Select(i => found.Sum(each => each.share * placeOf(each.known)[i])).ToArray();
            return new Known { Path = part => mean(known => known.Path(part)), Beside = mean(known => known.Beside), Back = mean(known => known.Back) };
        }

        Curve CurveOf(string clip, string joint, double[] at)
        {
            var animation = Read.List(gltf, "animations").Cast<Json>().FirstOrDefault(each => each.TryGetValue("name", out var name) && (string)name == clip);
            var chain = ChainOf(joint);
            if (animation == null || chain.Count == 0 || data < 0) return null;
            var every = new List<KeyValuePair<int, Track>>();
            foreach (var channel in Read.List(animation["channels"]).Cast<Json>())
            {
                var target = (Json)channel["target"];
                var sampler = (Json)Read.List(animation["samplers"]).ElementAt((int)Read.Number(channel["sampler"]));
                if (target.ContainsKey("node")) every.Add(new KeyValuePair<int, Track>((int)Read.Number(target["node"]), TrackOf(sampler, (string)target["path"])));
            }
            if (every.Any(each => each.Value == null)) return null;
            var tracks = every.Where(each => each.Value.Path != "weights").ToLookup(each => each.Key, each => each.Value);
            Func<double, double[]> shown = time => chain.Aggregate(at, (point, node) => Placed(nodes[node], tracks[node], time, point));
            var moving = chain.SelectMany(node => tracks[node]).Where(track => track.Times.Select((_, k) => track.Value(k)).Any(value => !value.SequenceEqual(track.Value(0)))).ToList();
            if (moving.Count == 0) return null;
            double start = every.Min(each => each.Value.Times[0]), end = every.Max(each => each.Value.Times.Last()), span = end - start;
            var smooth = moving.All(track => track.Smooth);
            var pieces = smooth ? Math.Max(Pieces, (int)Math.Ceiling(Samples * span)) : Pieces;
            var keys = new[] { start, end }.Concat(moving.SelectMany(track => track.Times)).Distinct().ToArray();
            // A place on a straight line between keys lies beside the smooth curve.
            var between = smooth || keys.Length <= Pieces ? Enumerable.Range(0, pieces + 1).Select(k => start + span * k / pieces) : new double[0];
            var all = keys.Concat(between).OrderBy(x => x).ToArray();
            var times = all.Where((time, k) => k == all.Length - 1 || all[k + 1] - time > Apart * span).ToArray();
            var points = times.Select(shown).ToArray();
            var whole = V.Minus(points[points.Length - 1], points[0]);
            var loops = moving.All(track => track.Path == "translation" || Closes(track)) && GoesRound(times, points);
            return new Curve { At = Through(times, points, loops, whole), Shown = shown, Seconds = loops ? span : 0, Whole = whole };
        }

        /// <summary>True if places go on from the last as they began at the first, apart from where they are.</summary>
        static bool GoesRound(double[] times, double[][] points)
        {
            var velocities = points.Skip(1).Select((point, k) => V.Minus(point, points[k]).Select(x => x / (times[k + 1] - times[k])).ToArray()).ToArray();
            var last = velocities.Length - 1;
            Func<int, int, double> change = (a, b) => V.Length(V.Minus(velocities[a], velocities[b]));
            var ranges = new[] { 0, 1, 2 }.Select(i => velocities.Max(each => each[i]) - velocities.Min(each => each[i])).ToArray();
            return change(0, last) <= Math.Max(Beside * Math.Max(change(1, 0), change(last, last - 1)), Overall * V.Length(ranges));
        }

        /// <summary>The nodes from a joint of a name, or of a path, up to the root.</summary>
        List<int> ChainOf(string joint)
        {
            Func<int, List<int>> chain = node =>
            {
                var found = new List<int> { node };
                while (parents.TryGetValue(found[found.Count - 1], out var above) && found.Count <= nodes.Count) found.Add(above);
                return found;
            };
            Func<int, string> name = node => nodes[node].TryGetValue("name", out var text) ? (string)text : "";
            var order = Enumerable.Range(0, nodes.Count).OrderBy(node => nodes[node].ContainsKey("mesh")).ToList();
            var at = order.Where(node => name(node) == joint).Concat(order.Where(node =>
                ("/" + string.Join("/", chain(node).AsEnumerable().Reverse().Select(name))).EndsWith("/" + joint))).DefaultIfEmpty(-1).First();
            return at < 0 ? new List<int>() : chain(at);
        }

        /// <summary>A point of a node in the space above it.</summary>
        static double[] Placed(Json node, IEnumerable<Track> tracks, double time, double[] point)
        {
            if (node.TryGetValue("matrix", out var matrix)) return V.Moved(Read.Numbers(matrix), point);
            Func<string, double[], double[]> part = (path, absent) =>
            {
                var track = tracks.FirstOrDefault(each => each.Path == path);
                return track != null ? Sampled(track, time) : node.TryGetValue(path, out var stored) ? Read.Numbers(stored) : absent;
            };
            var (t, q, s) = (part("translation", None), part("rotation", new[] { 0, 0, 0, 1.0 }), part("scale", new[] { 1.0, 1, 1 }));
            var p = point.Select((x, i) => x * s[i]).ToArray();
            var axis = new[] { q[0], q[1], q[2] };
            var aside = V.Cross(axis, p).Select((x, i) => x + q[3] * p[i]).ToArray();
            return V.Cross(axis, aside).Select((x, i) => p[i] + 2 * x + t[i]).ToArray();
        }

        static double[] Unit(double[] q) { var size = V.Length(q); return q.Select(x => x / size).ToArray(); }

        static double[] Sampled(Track track, double time)
        {
            var after = Array.FindIndex(track.Times, each => each > time);
            if (after == 0) return track.Value(0);
            if (after < 0) return track.Value(track.Times.Length - 1);
            var (a, b, span) = (track.Value(after - 1), track.Value(after), track.Times[after] - track.Times[after - 1]);
            var t = (time - track.Times[after - 1]) / span;
            if (track.Stepped) return a;
            if (track.Smooth)
            {
                var (leaving, coming) = (track.Keys[after - 1][2], track.Keys[after][0]);
                double t2 = t * t, t3 = t2 * t;
                var found = a.Select((x, i) => (2 * t3 - 3 * t2 + 1) * x + span * (t3 - 2 * t2 + t) * leaving[i] + (3 * t2 - 2 * t3) * b[i] + span * (t3 - t2) * coming[i]).ToArray();
                return track.Path == "rotation" ? Unit(found) : found;
            }
            if (track.Path != "rotation") return a.Select((x, i) => x + t * (b[i] - x)).ToArray();
            var near = V.Dot(a, b) < 0 ? -1 : 1;
            var angle = Math.Acos(Math.Min(Math.Abs(V.Dot(a, b)), 1));
            var (from, to) = angle < 1e-6 ? (1 - t, t) : (Math.Sin((1 - t) * angle) / Math.Sin(angle), Math.Sin(t * angle) / Math.Sin(angle));
            return Unit(a.Select((x, i) => from * x + to * near * b[i]).ToArray());
        }

        static bool Closes(Track track)
        {
            var (first, last) = (track.Value(0), track.Value(track.Times.Length - 1));
            return new[] { 1, -1 }.Any(sign => first.Select((x, k) => Math.Abs(x - sign * last[k])).All(gap => gap < Same));
        }

        /// <summary>The one of two numbers that is nearer to 0; 0 if their signs differ.</summary>
        static double Least(double a, double b) => a * b > 0 ? (Math.Abs(a) < Math.Abs(b) ? a : b) : 0;

        /// <summary>Slopes of a smooth curve through numbers at sorted times, which goes nowhere between equal ones.</summary>
        static double[] Slopes(double[] times, double[] values)
        {
            var last = times.Length - 1;
            var spans = times.Skip(1).Select((time, k) => time - times[k]).ToArray();
            var steps = spans.Select((span, k) => (values[k + 1] - values[k]) / span).ToArray();
            Func<int, double> at = k => (steps[k] - steps[k - 1]) / (spans[k] + spans[k - 1]);
            var bends = spans.Select((_, k) => Least(at(Math.Max(k, 1)), at(Math.Min(k + 1, last - 1)))).ToArray();
            var found = new double[last + 1];
            for (var k = 1; k < last; k++)
            {
                var mean = (spans[k] * steps[k - 1] + spans[k - 1] * steps[k]) / (spans[k] + spans[k - 1]);
                var tended = Least(steps[k - 1] + bends[k - 1] * spans[k - 1], steps[k] - bends[k] * spans[k]);
                var most = Math.Max(3 * Math.Abs(Least(steps[k - 1], steps[k])), 1.5 * Math.Abs(tended));
                found[k] = Least(mean, Math.Sign(tended) * most);
            }
            found[0] = Least(2 * steps[0] - found[1], 3 * steps[0]);
            found[last] = Least(2 * steps[last - 1] - found[last - 1], 3 * steps[last - 1]);
            return found;
        }

        /// <summary>The curve through points at sorted times; a loop goes on as it went, and `whole` is its way.</summary>
        static Func<double, double[]> Through(double[] times, double[][] points, bool loops, double[] whole)
        {
            var (last, around) = (times.Length - 1, loops ? Around : 0);
            var span = times[last] - times[0];
            var keys = Enumerable.Range(-around, last + 1 + 2 * around).Select(k => (round: loops ? (int)Math.Floor((double)k / last) : 0, key: loops ? (k % last + last) % last : k)).ToArray();
            var all = keys.Select(each => times[each.key] + each.round * span).ToArray();
            var slopes = new[] { 0, 1, 2 }.Select(i => Slopes(all, keys.Select(each => points[each.key][i] + each.round * whole[i]).ToArray()).Skip(around).ToArray()).ToArray();
            return time =>
            {
                var round = loops ? Math.Floor((time - times[0]) / span) : 0;
                var now = V.Clamp(time - round * span, times[0], times[last]);
                var after = Array.FindIndex(times, each => each > now);
                var k = after < 0 ? last - 1 : after - 1;
                var wide = times[k + 1] - times[k];
                var t = (now - times[k]) / wide;
                return new[] { 0, 1, 2 }.Select(i =>
                    round * whole[i] + points[k][i] * (1 + 2 * t) * (1 - t) * (1 - t) + points[k + 1][i] * t * t * (3 - 2 * t)
                    + wide * t * (1 - t) * (slopes[i][k] * (1 - t) - slopes[i][k + 1] * t)).ToArray();
            };
        }

        /// <summary>A channel; null if its data are not plain numbers of this file.</summary>
        Track TrackOf(Json sampler, string path)
        {
            var kind = sampler.TryGetValue("interpolation", out var said) ? (string)said : "LINEAR";
            var (times, values) = (Numbers(sampler["input"]), Numbers(sampler["output"]));
            if (times == null || values == null || times.Length == 0) return null;
            var (smooth, width) = (kind == "CUBICSPLINE", values.Length / times.Length / (kind == "CUBICSPLINE" ? 3 : 1));
            var each = smooth ? 3 : 1;
            var keys = times.Select((_, k) => Enumerable.Range(0, each).Select(n => values.Skip((k * each + n) * width).Take(width).ToArray()).ToArray()).ToArray();
            if (path == "rotation" && !smooth) foreach (var key in keys) key[0] = Unit(key[0]);
            return new Track { Path = path, Times = times, Keys = keys, Smooth = smooth, Stepped = kind == "STEP" };
        }

        double[] Numbers(object number)
        {
            var accessor = (Json)Read.List(gltf["accessors"]).ElementAt((int)Read.Number(number));
            if (accessor.ContainsKey("sparse") || !accessor.ContainsKey("bufferView")) return null;
            var view = (Json)Read.List(gltf["bufferViews"]).ElementAt((int)Read.Number(accessor["bufferView"]));
            if (view.ContainsKey("extensions") || Read.Number(view["buffer"]) != 0) return null;
            var (type, width) = ((int)Read.Number(accessor["componentType"]), new Dictionary<string, int> { ["SCALAR"] = 1, ["VEC3"] = 3, ["VEC4"] = 4 }[(string)accessor["type"]]);
            var size = type == 5126 ? 4 : type >= 5122 ? 2 : 1;
            var stride = (int)Read.Number(view, "byteStride", size * width);
            var start = data + (int)(Read.Number(view, "byteOffset", 0) + Read.Number(accessor, "byteOffset", 0));
            return Enumerable.Range(0, (int)Read.Number(accessor["count"]) * width).Select(k => One(type, start + k / width * stride + k % width * size)).ToArray();
        }

        double One(int type, int place) => type == 5126 ? BitConverter.ToSingle(file, place)
            : type == 5120 ? Math.Max((sbyte)file[place] / 127.0, -1) : type == 5121 ? file[place] / 255.0
            : type == 5122 ? Math.Max(BitConverter.ToInt16(file, place) / 32767.0, -1) : BitConverter.ToUInt16(file, place) / 65535.0;
    }
}
