# The clips of a .glb, for flesh: straight lines between a clip's keys kick it, and a bake lets it follow a smooth curve.
# One text for Godot 3 and 4. Give it to a body: `body.clips = load("clips.gd").new(gltf, stream, start)`.

const Numbers = preload("numbers.gd")
# Seconds of a clip in a second beyond which it has been put to another time.
const FASTEST = 4.0
# Keys by which a loop goes on at both ends: slopes depend on no others.
const AROUND = 2
# Pieces of a clip of few keys, and samples a second of one that is smooth between its keys, as a bake has them.
const PIECES = 4
const SAMPLES = 60.0
# Part of a clip below which two keys are a jump of the pose, which no curve follows: the later one counts.
const APART = 3e-5
# Difference of a quaternion or scale below which a clip ends in the pose of its beginning.
const SAME = 1e-3
# A loop's change of velocity, over that at the keys beside its ends, or over all change in it, at most.
const BESIDE = 2.0
const OVERALL = 0.1
const NONE = [0.0, 0.0, 0.0]
const WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}

var _gltf = {}
var _stream = null
var _start = 0
var _parents = {}
var _made = {}


# gltf    the JSON of a .glb
# stream  a StreamPeerBuffer with the whole file, or null if it has no buffer of its own: then no clip is known
# start   where the buffer begins in it
func _init(gltf, stream, start):
	_gltf = gltf
	_stream = stream
	_start = start
	for index in range(gltf.get("nodes", []).size()):
		for child in gltf["nodes"][index].get("children", []):
			_parents[int(child)] = index


# How a clip takes a joint's place through a frame, null if that is not known: `path`, places at the ends of its steps,
# `beside`, from the place that is shown to the curve, and `back`, how far a walk is put back where its clip begins anew.
#
# before  seconds of the clip at the last frame; NAN after another clip
# root    16 numbers by columns: the matrix to world space of what the file's scene stands below
func during(joint, at, clip, time, before, elapsed, root):
	var key = "%s %s %s" % [joint, at, clip]
	if not _made.has(key):
		_made[key] = _curve(joint, at, clip)
	var curve = _made[key]
	if curve == null:
		return null
	var anew = time < before and curve["seconds"] > 0
	var ran = time - before + (curve["seconds"] if anew else 0.0)
	var runs = ran >= 0 and ran <= FASTEST * elapsed
	var path = []
	var steps = Numbers.steps(elapsed)
	for k in range(steps + 1):
		path.append(_turned(root, _on(curve, time - ((1.0 - k / float(steps)) * ran if runs else 0.0))))
	var beside = Numbers.sum(_on(curve, time), _shown(curve, time), -1.0)
	var back = Numbers.times(-1.0, curve["whole"]) if anew and runs else NONE
	return {"path": path, "beside": _turned(root, beside), "back": _turned(root, back)}


# The same while clips blend: `playing` has rows of a clip, its seconds, those at the last frame, and a share; shares add up to 1.
func blended(joint, at, playing, elapsed, root):
	var steps = Numbers.steps(elapsed)
	var found = {"path": [], "beside": NONE, "back": NONE}
	for _k in range(steps + 1):
		found["path"].append(NONE)
	for each in playing:
		var known = during(joint, at, each[0], each[1], each[2], elapsed, root)
		if known != null:
			for k in range(steps + 1):
				found["path"][k] = Numbers.sum(found["path"][k], known["path"][k], each[3])
			found["beside"] = Numbers.sum(found["beside"], known["beside"], each[3])
			found["back"] = Numbers.sum(found["back"], known["back"], each[3])
	return found


func _turned(root, v):
	return Numbers.sum(Numbers.moved(root, v), Numbers.moved(root, NONE), -1.0)


func _curve(joint, at, clip):
	var chain = _chain_of(joint)
	var animation = null
	for each in _gltf.get("animations", []):
		if animation == null and each.get("name") == clip:
			animation = each
	if animation == null or chain.size() == 0 or _stream == null:
		return null
	var tracks = {}
	var moving = []
	var start = INF
	var end = -INF
	for channel in animation["channels"]:
		if not channel["target"].has("node"):
			continue
		var track = _track(animation["samplers"][int(channel["sampler"])], channel["target"]["path"])
		if track == null:
			return null
		start = Numbers.smaller(start, track["times"][0])
		end = Numbers.larger(end, track["times"][-1])
		var node = int(channel["target"]["node"])
		if track["path"] != "weights" and chain.has(node):
			tracks["%d %s" % [node, track["path"]]] = track
			if track["moves"]:
				moving.append(track)
	if moving.size() == 0:
		return null
	var span = end - start
	var smooth = true
	var loops = true
	var every = [start, end]
	for track in moving:
		smooth = smooth and track["smooth"]
		loops = loops and (track["path"] == "translation" or _closes(track))
		for time in track["times"]:
			if not every.has(time):
				every.append(time)
	# A place on a straight line between keys lies beside the smooth curve.
	if smooth or every.size() <= PIECES:
		var pieces = int(Numbers.larger(PIECES, ceil(SAMPLES * span))) if smooth else PIECES
		for k in range(pieces + 1):
			every.append(start + span * k / pieces)
	every.sort()
	var curve = {"chain": chain, "tracks": tracks, "at": at}
	var times = []
	var points = []
	for k in range(every.size()):
		if k + 1 == every.size() or every[k + 1] - every[k] > APART * span:
			times.append(every[k])
			points.append(_shown(curve, every[k]))
	var last = times.size() - 1
	curve["whole"] = Numbers.sum(points[last], points[0], -1.0)
	loops = loops and _goes_round(times, points)
	curve["seconds"] = span if loops else 0.0
	curve["times"] = times
	curve["points"] = points
	var all = times
	var places = points
	if loops:
		# A walk goes on as it went.
		all = []
		places = []
		for k in range(-AROUND, last + 1 + AROUND):
			var turn = floor(float(k) / last)
			var inner = k - int(turn) * last
			all.append(times[inner] + turn * span)
			places.append(Numbers.sum(points[inner], curve["whole"], turn))
	curve["slopes"] = []
	for i in range(3):
		var values = []
		for each in places:
			values.append(each[i])
		curve["slopes"].append(_slopes(all, values))
	curve["skipped"] = AROUND if loops else 0
	return curve


# True if places go on from the last as they began at the first, apart from where they are.
func _goes_round(times, points):
	var velocities = []
	for k in range(times.size() - 1):
		velocities.append(Numbers.times(1.0 / (times[k + 1] - times[k]), Numbers.sum(points[k + 1], points[k], -1.0)))
	var ranges = []
	for i in range(3):
		var low = INF
		var high = -INF
		for each in velocities:
			low = Numbers.smaller(low, each[i])
			high = Numbers.larger(high, each[i])
		ranges.append(high - low)
	var beside = Numbers.larger(_change(velocities, 1, 0), _change(velocities, -1, -2))
	return _change(velocities, 0, -1) <= Numbers.larger(BESIDE * beside, OVERALL * Numbers.length(ranges))


func _change(velocities, a, b):
	return Numbers.length(Numbers.sum(velocities[a], velocities[b], -1.0))


# The nodes from a joint of a name, or of a path, up to the root: one without a mesh first.
func _chain_of(joint):
	var paths = []
	var nodes = _gltf.get("nodes", [])
	for meshes in [false, true]:
		for node in range(nodes.size()):
			if nodes[node].has("mesh") != meshes:
				continue
			var chain = [node]
			while _parents.has(chain[-1]) and chain.size() <= nodes.size():
				chain.append(_parents[chain[-1]])
			if nodes[node].get("name", "") == joint:
				return chain
			var path = ""
			for each in chain:
				path = "/" + nodes[each].get("name", "") + path
			paths.append([path, chain])
	for each in paths:
		if each[0].ends_with("/" + joint):
			return each[1]
	return []


# The place that the joint carries at a time of the clip, in the space of the file's scene.
func _shown(curve, time):
	var point = curve["at"]
	for node in curve["chain"]:
		var stored = _gltf["nodes"][node]
		if stored.has("matrix"):
			point = Numbers.moved(stored["matrix"], point)
			continue
		var parts = []
		for path in ["translation", "rotation", "scale"]:
			var track = curve["tracks"].get("%d %s" % [node, path])
			var absent = {"translation": NONE, "rotation": [0.0, 0.0, 0.0, 1.0], "scale": [1.0, 1.0, 1.0]}[path]
			parts.append(stored.get(path, absent) if track == null else _sampled(track, time))
		var scale = parts[2]
		var q = parts[1]
		var p = [point[0] * scale[0], point[1] * scale[1], point[2] * scale[2]]
		var aside = Numbers.sum(Numbers.cross(q, p), p, q[3])
		point = Numbers.sum(Numbers.sum(p, Numbers.cross(q, aside), 2.0), parts[0])
	return point


func _value(track, key):
	return track["keys"][key][1 if track["smooth"] else 0]


func _unit(q):
	return Numbers.times(1.0 / Numbers.length(q), q)


func _sampled(track, time):
	var times = track["times"]
	var after = times.bsearch(time, false)
	if after == 0:
		return _value(track, 0)
	if after == times.size():
		return _value(track, after - 1)
	var a = _value(track, after - 1)
	var b = _value(track, after)
	var span = times[after] - times[after - 1]
	var t = (time - times[after - 1]) / span
	if track["stepped"]:
		return a
	if track["smooth"]:
		var t2 = t * t
		var t3 = t2 * t
		var found = Numbers.sum(Numbers.times(2.0 * t3 - 3.0 * t2 + 1.0, a), b, 3.0 * t2 - 2.0 * t3)
		found = Numbers.sum(found, track["keys"][after - 1][2], span * (t3 - 2.0 * t2 + t))
		found = Numbers.sum(found, track["keys"][after][0], span * (t3 - t2))
		return _unit(found) if track["path"] == "rotation" else found
	if track["path"] != "rotation":
		return Numbers.sum(a, Numbers.sum(b, a, -1.0), t)
	var near = Numbers.dot(a, b)
	var angle = acos(Numbers.smaller(abs(near), 1.0))
	var from = 1.0 - t if angle < 1e-6 else sin((1.0 - t) * angle) / sin(angle)
	var to = t if angle < 1e-6 else sin(t * angle) / sin(angle)
	return _unit(Numbers.sum(Numbers.times(from, a), b, -to if near < 0 else to))


func _closes(track):
	var first = _value(track, 0)
	var last = _value(track, track["times"].size() - 1)
	for factor in [1.0, -1.0]:
		var most = 0.0
		for gap in Numbers.sum(first, last, -factor):
			most = Numbers.larger(most, abs(gap))
		if most < SAME:
			return true
	return false


# The one of two numbers that is nearer to 0; 0 if their signs differ.
static func _least(a, b):
	return (a if abs(a) < abs(b) else b) if a * b > 0 else 0.0


# Slopes of a smooth curve through numbers at sorted times, which goes nowhere between equal ones.
static func _slopes(times, values):
	var last = times.size() - 1
	var spans = []
	var steps = []
	for k in range(last):
		spans.append(times[k + 1] - times[k])
		steps.append((values[k + 1] - values[k]) / spans[k])
	var at = []
	for k in range(last - 1):
		at.append((steps[k + 1] - steps[k]) / (spans[k + 1] + spans[k]))
	at = [at[0]] + at + [at[-1]]
	var found = [0.0]
	for k in range(1, last):
		var mean = (spans[k] * steps[k - 1] + spans[k - 1] * steps[k]) / (spans[k] + spans[k - 1])
		var before = steps[k - 1] + _least(at[k - 1], at[k]) * spans[k - 1]
		var tended = _least(before, steps[k] - _least(at[k], at[k + 1]) * spans[k])
		var most = Numbers.larger(3.0 * abs(_least(steps[k - 1], steps[k])), 1.5 * abs(tended))
		found.append(_least(mean, sign(tended) * most))
	found[0] = _least(2.0 * steps[0] - found[1], 3.0 * steps[0])
	found.append(_least(2.0 * steps[-1] - found[-1], 3.0 * steps[-1]))
	return found


# The curve's place at a time; a loop goes on as it went.
func _on(curve, time):
	var times = curve["times"]
	var last = times.size() - 1
	var turn = floor((time - times[0]) / curve["seconds"]) if curve["seconds"] > 0 else 0.0
	var now = Numbers.held(time - turn * curve["seconds"], times[0], times[last])
	var k = int(Numbers.held(times.bsearch(now, false) - 1, 0, last - 1))
	var wide = times[k + 1] - times[k]
	var t = (now - times[k]) / wide
	var u = 1.0 - t
	var found = Numbers.sum(Numbers.times((1.0 + 2.0 * t) * u * u, curve["points"][k]), curve["points"][k + 1], t * t * (3.0 - 2.0 * t))
	for i in range(3):
		var slopes = curve["slopes"][i]
		var first = k + curve["skipped"]
		found[i] += turn * curve["whole"][i] + wide * t * u * (slopes[first] * u - slopes[first + 1] * t)
	return found


# A channel; null if its data are not plain numbers of this file.
func _track(sampler, path):
	var times = _numbers(sampler["input"])
	var values = _numbers(sampler["output"])
	if times == null or values == null or times.size() == 0:
		return null
	var kind = sampler.get("interpolation", "LINEAR")
	var parts = 3 if kind == "CUBICSPLINE" else 1
	var width = int(values.size() / float(times.size() * parts))
	var found = {"path": path, "times": times, "keys": [], "moves": false}
	found["smooth"] = parts == 3
	found["stepped"] = kind == "STEP"
	for k in range(times.size()):
		var key = []
		for part in range(parts):
			var value = []
			for i in range(width):
				value.append(values[(k * parts + part) * width + i])
			key.append(_unit(value) if path == "rotation" and parts == 1 else value)
		found["keys"].append(key)
		found["moves"] = found["moves"] or _value(found, k) != _value(found, 0)
	return found


func _numbers(number):
	var accessor = _gltf["accessors"][int(number)]
	if accessor.has("sparse") or not accessor.has("bufferView"):
		return null
	var view = _gltf["bufferViews"][int(accessor["bufferView"])]
	if view.has("extensions") or view["buffer"] != 0:
		return null
	var type = int(accessor["componentType"])
	var size = 4 if type == 5126 else (2 if type >= 5122 else 1)
	var width = WIDTHS[accessor["type"]]
	var stride = int(view.get("byteStride", size * width))
	var first = _start + int(view.get("byteOffset", 0)) + int(accessor.get("byteOffset", 0))
	var found = []
	for k in range(int(accessor["count"])):
		_stream.seek(first + k * stride)
		for _i in range(width):
			match type:
				5126: found.append(_stream.get_float())
				5120: found.append(Numbers.larger(_stream.get_8() / 127.0, -1.0))
				5121: found.append(_stream.get_u8() / 255.0)
				5122: found.append(Numbers.larger(_stream.get_16() / 32767.0, -1.0))
				_: found.append(_stream.get_u16() / 65535.0)
	return found
