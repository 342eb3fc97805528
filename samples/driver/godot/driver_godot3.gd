# The driver for Godot 3: a node right below the root of an imported scene. Beside it stands driver.gd, with what that needs.
#
# `gltf` is the baked file, from which the extras are read: so export *.glb with the game.
extends "driver.gd"

export(String, FILE, "*.glb,*.gltf") var gltf = ""


func _ready():
	begin(gltf)


func bytes_of(path):
	var file = File.new()
	return file.get_buffer(file.get_len()) if file.open(path, File.READ) == OK else null


func value_of(text):
	return JSON.parse(text).result
