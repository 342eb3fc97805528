# Sets blend shapes of baked characters, in Godot 3 and 4 alike. driver_godot3.gd and driver_godot4.gd are nodes that extend it.
#
# Beside it stand wrinkle.gd, joints.gd, clips.gd and numbers.gd.
extends Node

const Wrinkle = preload("wrinkle.gd")
const Clips = preload("clips.gd")
# Of a clip that is played unseen.
const FRAMES_PER_SECOND = 60

# Where the player's own tips touch: {TOUCH: {"slide": [forward, sideways], "depth": depth}}, scene units.
var hands = {}
# For each node that was baked its `body`, `meshes`, `shapes` of each mesh by target, and `joints` by name.
var bodies = []
# The file's own clips, in its bytes, from where its buffer begins.
var clips = null
var stream = StreamPeerBuffer.new()
var start = 0


# Finds what a baked file drives.
func begin(gltf):
	# After animation players, which have 0.
	process_priority = 100
	var file = read(gltf)
	clips = Clips.new(file, stream if start > 0 else null, start)
	for node in file.get("nodes", []):
		var extras = node.get("extras")
		if extras is Dictionary and extras.get("wrinkle") is Dictionary and node.has("mesh"):
			add(file, node, extras["wrinkle"])
	if bodies.size() == 0:
		push_warning("wrinkle: nothing to drive: no node of %s has extras.wrinkle and a mesh here" % gltf)


func _process(delta):
	for player in below(get_parent()):
		if player is AnimationPlayer and player.is_playing():
			drive(str(player.current_animation), player.current_animation_position, delta)
			return
	drive("", 0.0, delta)


# Brings springs to the beginning of a clip that loops, which begins as it ends: plays it unseen as often as they need. Call it
# when the loop starts.
func settle(player, clip):
	var seconds = player.get_animation(clip).length
	var rounds = 0
	for each in bodies:
		rounds = int(max(rounds, each["body"].unseen_rounds(seconds)))
	var frames = int(max(ceil(FRAMES_PER_SECOND * seconds), 1))
	player.play(clip)
	for frame in range(rounds * frames + 1):
		var time = seconds * (frame % frames) / frames
		player.seek(time, true)
		# At first all is at rest.
		drive(clip, time, seconds / frames if frame > 0 else NAN)


# The weights of a frame, from the pose in which the bones are: a clip's name, its seconds, and those since the last frame.
func drive(clip, time, elapsed):
	for each in bodies:
		var matrices = {}
		for joint in each["joints"]:
			matrices[joint] = matrix(each["joints"][joint])
		var morphs = {}
		for target in each["shapes"][0]:
			morphs[target] = each["meshes"][0].get(each["shapes"][0][target])
		each["body"].clips = clips
		each["body"].root = matrix([get_parent(), -1])
		show_weights(each, each["body"].weights(matrices, morphs, clip, time, elapsed, hands), morphs)


# Sets what `drive` has found of a body, and the weights of the asset's own morph targets, which move other parts as the first.
func show_weights(each, found, morphs):
	for k in range(each["meshes"].size()):
		for target in each["shapes"][k]:
			var weight = found[target] if found.has(target) else morphs.get(target)
			if weight != null:
				each["meshes"][k].set(each["shapes"][k][target], weight)


func add(file, node, wrinkle):
	var meshes = []
	var shapes = []
	var there = {}
	for part in [node["name"]] + wrinkle.get("parts", []):
		var found = named(part)
		if found == null:
			push_warning("wrinkle: there is no mesh \"%s\"" % part)
			continue
		meshes.append(found)
		shapes.append(shapes_of(file, part, found))
		for target in shapes[-1]:
			there[target] = true
	if meshes.size() == 0:
		return
	var joints = joints_of(meshes[0])
	var known = {}
	for each in all_drives(wrinkle):
		for joint in Wrinkle.joints_of(each):
			if joints.has(plain(joint)):
				known[joint] = joints[plain(joint)]
	var body = body_of(wrinkle, known, there)
	for line in body.problems:
		push_warning("wrinkle: %s: %s" % [node["name"], line])
	bodies.append({"body": body, "meshes": meshes, "shapes": shapes, "joints": known})


func body_of(wrinkle, joints, targets):
	return Wrinkle.new(wrinkle, joints, targets)


func all_drives(wrinkle):
	var found = []
	for kind in Wrinkle.KINDS:
		found += wrinkle.get(kind, [])
	return found


# By target the property of a mesh: importers keep the order of morph targets, not always their names.
func shapes_of(file, part, instance):
	var names = []
	for node in file["nodes"]:
		if node.get("name") == part and node.has("mesh"):
			names = file["meshes"][node["mesh"]].get("extras", {}).get("targetNames", [])
	var found = {}
	for k in range(instance.mesh.get_blend_shape_count()):
		var shape = instance.mesh.get_blend_shape_name(k)
		found[names[k] if k < names.size() else shape] = "blend_shapes/" + shape
	return found


# By plain name [skeleton, bone], or [node, -1]: the mesh's own bones first, as characters often share names.
func joints_of(instance):
	var nodes = below(get_parent())
	var own = instance.get_node_or_null(instance.skeleton)
	var found = {}
	if not is_skeleton(own):
		found[plain(instance.name)] = [instance, -1]
	for skeleton in [own] + nodes:
		if is_skeleton(skeleton):
			for bone in range(skeleton.get_bone_count()):
				var label = plain(skeleton.get_bone_name(bone))
				if not found.has(label):
					found[label] = [skeleton, bone]
	for node in nodes:
		if is_of(node, "Spatial", "Node3D") and not found.has(plain(node.name)):
			found[plain(node.name)] = [node, -1]
	return found


# A joint's matrix to world space: 16 numbers by columns.
func matrix(joint):
	var place = joint[0].global_transform
	if joint[1] >= 0:
		place = place * joint[0].get_bone_global_pose(joint[1])
	var found = []
	for column in [place.basis.x, place.basis.y, place.basis.z, place.origin]:
		found += [column.x, column.y, column.z, 1.0 if found.size() == 12 else 0.0]
	return found


func named(label):
	for node in below(get_parent()):
		if is_of(node, "MeshInstance", "MeshInstance3D") and node.mesh != null and plain(node.name) == plain(label):
			return node
	return null


func is_skeleton(node):
	return node != null and is_of(node, "Skeleton", "Skeleton3D")


# Classes of nodes have names of their own in Godot 3 and 4.
func is_of(node, name3, name4):
	return node.is_class(name3) or node.is_class(name4)


func below(node):
	var found = [node]
	for child in node.get_children():
		found += below(child)
	return found


# Importers change names: capital letters, dots, colons and slashes are not told apart.
func plain(label):
	var found = ""
	for letter in str(label).to_lower():
		if not letter in "_.:/@ \"-":
			found += letter
	return found


# The JSON of a .glb or .gltf file, and of a .glb its bytes into `stream`.
func read(path):
	var bytes = bytes_of(path)
	if bytes == null:
		push_warning("wrinkle: cannot read %s" % path)
		return {}
	stream.data_array = bytes
	# Of a .glb: 12 bytes of header, then each chunk's length and kind before it: that of JSON and that of bytes.
	var size = stream.get_size()
	if size > 28 and stream.get_string(4) == "glTF":
		stream.seek(12)
		size = stream.get_u32()
		start = 28 + size
	stream.seek(20 if start > 0 else 0)
	var found = value_of(stream.get_utf8_string(size))
	return found if found is Dictionary else {}


# The bytes of a file, or null: a node says it, as the engines do it differently.
func bytes_of(_path):
	return null


# The value of a text of JSON: a node says it.
func value_of(_text):
	return null
